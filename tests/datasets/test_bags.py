"""Bags of ROS 1 and ROS 2 hold the rendered room; what is missing in one is said in a line that lists what there is."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.datasets.scene import CAMERA, pose, render
from uppm.cli.main import app
from uppm.core.config import Config, InputConfig
from uppm.core.errors import BadFrameError, InputError, MissingExtraError
from uppm.core.geometry import invert, pose_from_quaternion
from uppm.datasets import check_sequence, open_sequence
from uppm.datasets.bags.transforms import NoTransformError, TransformTree

pytest.importorskip("rosbags", reason="pip install uppm[ros] brings rosbags, with which bags are written here")
from tests.datasets import bags


def opened(path: Path, **settings: object):
    return open_sequence(path, InputConfig(**settings))  # pyright: ignore[reportArgumentType]


def assert_the_room(sequence, depth_tolerance: float = 0.0006) -> None:
    assert len(sequence) == bags.COUNT
    for i in range(bags.COUNT):
        frame, (color, depth) = sequence.frame(i), render(pose(i))
        np.testing.assert_allclose(frame.T_map_camera, pose(i), atol=1e-6)
        np.testing.assert_array_equal(frame.color, color)
        np.testing.assert_allclose(frame.depth, depth, atol=depth_tolerance)
        assert frame.stamp == pytest.approx(bags.stamp(i), abs=1e-6)
        assert frame.intrinsics == CAMERA


each_kind = pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])


def maker(kind: str) -> bags.Maker:
    return bags.Maker(ros1=kind == "ros1")


def written(folder: Path, kind: str, messages: list) -> Path:
    """A bag of a kind."""
    ros1 = kind == "ros1"
    return bags.write(folder / ("room.bag" if ros1 else "room"), messages, ros1=ros1, mcap=kind == "mcap")


@each_kind
def test_each_kind_of_bag_holds_the_room(tmp_path: Path, kind: str) -> None:
    path = written(tmp_path, kind, bags.room(maker(kind)))
    assert_the_room(opened(path))
    if kind != "ros1":
        (inner,) = [file for file in path.iterdir() if file.suffix in (".mcap", ".db3")]
        assert_the_room(opened(inner))


@each_kind
@pytest.mark.parametrize(
    ("color", "depth", "tolerance"),
    [
        ("bgr8", "32FC1", 1e-6),
        ("compressed", "16UC1; compressedDepth png", 0.0006),
        ("rgb8", "32FC1; compressedDepth png", 0.003),
    ],
)
def test_encodings(tmp_path: Path, kind: str, color: str, depth: str, tolerance: float) -> None:
    messages = bags.room(maker(kind), color=color, depth=depth)
    assert_the_room(opened(written(tmp_path, kind, messages)), tolerance)


@each_kind
def test_it_passes_the_check_and_maps(tmp_path: Path, kind: str) -> None:
    import uppm

    path = written(tmp_path, kind, bags.room(maker(kind)))
    result = check_sequence(opened(path))
    assert result.ok, result.findings
    assert result.format == "bag"
    uppm.map_sequence(opened(path), tmp_path / "room.uppm", Config.load(None, ["fusion.max_blocks=20000"]))
    mesh = uppm.open_map(tmp_path / "room.uppm").mesh()
    assert len(mesh.faces) > 1000


@each_kind
def test_poses_of_a_topic_are_carried_to_the_camera(tmp_path: Path, kind: str) -> None:
    m = maker(kind)
    messages = [each for each in bags.room(m) if each[0] != "/tf"]
    for i in range(bags.COUNT):
        odometry = m.odometry(bags.stamp(i), pose(i) @ invert(bags.OPTICAL), "base_link")
        messages.append(("/odom", "nav_msgs/msg/Odometry", bags.stamp(i), odometry))
    path = written(tmp_path, kind, messages)
    assert_the_room(opened(path, pose_topic="/odom"))
    with pytest.raises(InputError, match=r"a moving transform above the colour camera's frame 'camera'.*/odom"):
        opened(path)
    as_camera = opened(path, pose_topic="/odom", pose_frame="camera").frame(1)
    np.testing.assert_allclose(as_camera.T_map_camera, pose(1) @ invert(bags.OPTICAL), atol=1e-6)


def test_poses_between_two_transforms_are_interpolated(tmp_path: Path) -> None:
    messages = bags.room(bags.Maker(ros1=False))
    whole = [each for each in messages if each[0] != "/tf" or round((each[2] - bags.START) * 20) % 2 != 0]
    frame = opened(bags.write(tmp_path / "room", whole)).frame(2)
    assert np.abs(frame.T_map_camera - pose(2)).max() < 0.005
    assert np.linalg.det(frame.T_map_camera[:3, :3]) == pytest.approx(1)


def test_frames_after_the_last_transform_are_bad_frames(tmp_path: Path) -> None:
    messages = [each for each in bags.room(bags.Maker(ros1=False)) if each[0] != "/tf" or each[2] < bags.START + 0.22]
    sequence = opened(bags.write(tmp_path / "room", messages))
    sequence.frame(2)
    with pytest.raises(BadFrameError, match=r"expected a pose, found none: '\w+' to '\w+': 0\.1\d\d s after the last"):
        sequence.frame(3)


def test_a_tree_that_runs_on_forgets_old_transforms() -> None:
    tree, moved = TransformTree(), np.eye(4)
    for time in range(5):
        moved[0, 3] = time
        tree.add("map", "base", float(time), moved.copy(), fixed=False)
    tree.forget("/base", before=2.0)
    assert tree.lookup("map", "base", 2.5, 0.0)[0, 3] == 2.5
    with pytest.raises(NoTransformError, match=r"1.000 s before the first of 3"):
        tree.lookup("map", "base", 1.0, 0.0)
    tree.forget("base", before=9.0)
    assert tree.lookup("map", "base", 4.0, 0.0)[0, 3] == 4


def test_a_depth_camera_of_its_own_is_registered(tmp_path: Path) -> None:
    m = bags.Maker(ros1=False)
    T_color_depth = pose_from_quaternion([0.03, 0, 0], [0, 0, 0, 1.0])
    messages = [*bags.color_messages(m), *bags.transform_messages(m)]
    fixed = m.tf2_msgs__TFMessage(transforms=[m.transform(bags.START, "camera", "depth", T_color_depth)])
    messages.append(("/tf_static", "tf2_msgs/msg/TFMessage", bags.START, fixed))
    small = replace(CAMERA, fx=65.0, fy=65.0, cx=39.5, cy=29.5, width=80, height=60)
    info = m.info(bags.START, "depth", small)
    messages.append(("/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", bags.START, info))
    for i in range(bags.COUNT):
        depth = render(pose(i) @ T_color_depth, small)[1]
        image = m.image(bags.stamp(i), "depth", "32FC1", depth)
        messages.append(("/camera/depth/image_rect", "sensor_msgs/msg/Image", bags.stamp(i), image))
    frame = opened(bags.write(tmp_path / "room", messages)).frame(1)
    expected = render(pose(1))[1]
    assert frame.depth.shape == expected.shape
    assert np.median(np.abs(frame.depth - expected)[frame.depth > 0]) < 0.01


def test_lens_distortion_is_taken_out(tmp_path: Path) -> None:
    import cv2

    m = bags.Maker(ros1=False)
    D = (0.12, -0.05, 0.001, -0.002, 0.0)
    grid = np.stack(np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height)), axis=-1).astype(np.float32)
    straight = cv2.undistortPoints(grid.reshape(-1, 1, 2), CAMERA.matrix, np.array(D), P=CAMERA.matrix)
    maps = straight.reshape(*grid.shape).astype(np.float32)
    messages = [each for each in bags.room(m) if "color" not in each[0]]
    messages.append(("/cam/color/camera_info", "sensor_msgs/msg/CameraInfo", bags.START, m.info(0, "camera", D=D)))
    for i in range(bags.COUNT):
        bent = cv2.remap(render(pose(i))[0], maps[..., 0], maps[..., 1], cv2.INTER_LINEAR)
        image = m.image(bags.stamp(i), "camera", "rgb8", bent)
        messages.append(("/cam/color/image_raw", "sensor_msgs/msg/Image", bags.stamp(i), image))
    got = opened(bags.write(tmp_path / "room", messages)).frame(0).color[10:-10, 10:-10].astype(int)
    wanted = render(pose(0))[0][10:-10, 10:-10].astype(int)
    assert np.abs(got - wanted).mean() < 3


def without(messages: list, *topics: str) -> list:
    return [each for each in messages if not each[0].startswith(topics)]


@each_kind
@pytest.mark.parametrize(
    ("gone", "message"),
    [
        ("/camera/depth", r"expected a depth topic .*/camera/color/image_raw \(sensor_msgs/Image\).*input.depth_topic"),
        ("/camera/color", r"expected a colour topic .*/camera/depth/image_rect.*input.color_topic"),
        ("/camera/color/camera_info", r"intrinsics of /camera/color/image_raw at /camera/color/camera_info.*depth/cam"),
        ("/tf", r"a moving transform above .* found no /tf or /tf_static message"),
        ("/tf_static", r"chain of transforms|a moving transform above the colour camera's frame 'camera'.*map, odom"),
    ],
)
def test_what_is_missing_is_said_with_what_there_is(tmp_path: Path, kind: str, gone: str, message: str) -> None:
    messages = bags.room(maker(kind))
    kept = [each for each in messages if each[0] != gone] if gone == "/tf_static" else without(messages, gone)
    path = written(tmp_path, kind, kept)
    with pytest.raises(InputError, match=message) as error:
        opened(path)
    assert "\n" not in str(error.value)


def test_other_wrong_input_is_one_line(tmp_path: Path) -> None:
    m = bags.Maker(ros1=False)
    path = bags.write(tmp_path / "room", bags.room(m))
    with pytest.raises(InputError, match=r"no topic /nowhere; topics: /camera/color/camera_info"):
        opened(path, color_topic="/nowhere")
    with pytest.raises(InputError, match=r"found /tf of type tf2_msgs/TFMessage"):
        opened(path, depth_topic="/tf")
    with pytest.raises(
        InputError, match=r"from 'moon' to the colour camera's frame 'camera', found transforms of base"
    ):
        opened(path, map_frame="moon")
    apart = [*bags.color_messages(m), *bags.depth_messages(m, late=0.05), *bags.transform_messages(m)]
    with pytest.raises(InputError, match=r"within 0.02 s of each other, found none, the nearest pair 0\.05"):
        opened(bags.write(tmp_path / "apart", apart))
    assert len(opened(tmp_path / "apart", time_tolerance=0.06)) == bags.COUNT
    broken = tmp_path / "broken.bag"
    broken.write_bytes(b"#ROSBAG V2.0\nnot much")
    with pytest.raises(InputError, match=r"broken\.bag: expected a ROS bag, found one that cannot be read"):
        opened(broken)


def test_the_command_checks_a_bag_and_says_what_is_missing(tmp_path: Path) -> None:
    path = str(bags.write(tmp_path / "room", without(bags.room(bags.Maker(ros1=False)), "/camera/depth/camera_info")))
    missing = CliRunner().invoke(app, ["check", path])
    assert isinstance(missing.exception, InputError)
    assert "at /camera/depth/camera_info, found camera_info only at /camera/color/camera_info" in str(missing.exception)
    named = ["check", path, "--set", "input.depth_info_topic=/camera/color/camera_info"]
    assert CliRunner().invoke(app, named).exit_code == 0


def test_without_the_library_the_command_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "room.mcap").write_bytes(b"")
    for name in [name for name in sys.modules if name.partition(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(MissingExtraError, match=r"pip install uppm\[ros\]"):
        opened(tmp_path / "room.mcap")
