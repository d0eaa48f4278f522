"""Wrong input: each kind gives its one line, naming file, expected, found and what to do."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.datasets import formats, scene
from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError, ConfigError, InputError
from uppm.datasets import open_sequence
from uppm.datasets.registry import READERS


@pytest.fixture
def room(tmp_path: Path) -> Path:
    return scene.write_frames(tmp_path / "room", count=3)


def one_line(error: InputError) -> str:
    message = str(error)
    assert "\n" not in message
    assert "expected " in message
    assert ", found " in message
    assert "; " in message
    return message


def refused(path: Path, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        open_sequence(path, InputConfig.model_validate(options))
    return one_line(caught.value)


def bad_frame(path: Path, index: int = 1) -> BadFrameError:
    source = open_sequence(path)
    with pytest.raises(BadFrameError) as caught:
        source.frame(index)
    one_line(caught.value)
    assert source.frame(0).index == 0
    return caught.value


def test_no_such_path(tmp_path: Path) -> None:
    assert "nothing there" in refused(tmp_path / "absent")


def test_empty_folder_lists_the_formats(tmp_path: Path) -> None:
    message = refused(tmp_path)
    assert "found an empty folder" in message
    assert all(f"{name} (" in message for name in READERS)


def test_unknown_folder_and_file(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    assert "found none of their marks" in refused(tmp_path)
    assert "found none of their marks" in refused(tmp_path / "notes.txt")


def test_unknown_format(room: Path) -> None:
    with pytest.raises(ConfigError, match="'kitti'"):
        open_sequence(room, InputConfig(format="kitti"))


def cut(path: Path, share: float = 0.6) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


@pytest.mark.parametrize("file", ["color/00001.png", "depth/00001.png"])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.6, 0.99])
def test_truncated_png(room: Path, file: str, share: float) -> None:
    cut(room / file, share)
    error = bad_frame(room)
    assert error.source == str(room / file)
    assert error.found == "a truncated or unreadable image"


def test_truncated_jpeg(tmp_path: Path) -> None:
    path = formats.replica(tmp_path / "room")
    cut(path / "results/frame000001.jpg")
    assert bad_frame(path).found == "a truncated or unreadable image"


def test_png_with_damaged_data(room: Path) -> None:
    path = room / "depth/00001.png"
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 40] = bytes(40)
    path.write_bytes(bytes(data))
    assert bad_frame(room).found == "a truncated or unreadable image"


@pytest.mark.parametrize("file", ["color/00001.png", "depth/00001.png", "pose/00001.txt"])
def test_missing_file(room: Path, file: str) -> None:
    (room / file).unlink()
    error = bad_frame(room)
    assert error.found == "a missing file"
    assert Path(error.source).with_suffix("") == (room / file).with_suffix("")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_pose_not_finite(room: Path, value: float) -> None:
    T = scene.pose(1)
    T[0, 3] = value
    (room / "pose/00001.txt").write_text(scene.text(T))
    error = bad_frame(room)
    assert error.source == str(room / "pose/00001.txt")
    assert error.found == "NaN or infinity in the pose"


@pytest.mark.parametrize("change", [np.diag([2.0, 2, 2, 1]), np.diag([1.0, 1, -1, 1])])
def test_pose_not_rigid(room: Path, change: np.ndarray) -> None:
    (room / "pose/00001.txt").write_text(scene.text(scene.pose(1) @ change))
    assert bad_frame(room).found == "a pose that is not rigid"


def test_pose_of_another_shape_or_text(room: Path) -> None:
    (room / "pose/00001.txt").write_text("1 2 3\n")
    assert bad_frame(room).found == "another count of numbers in the pose file"
    (room / "pose/00001.txt").write_text("one two\n")
    assert bad_frame(room).found == "text that is not numbers"


def test_image_of_another_size(room: Path) -> None:
    scene.image(room / "color/00001.png", np.zeros((60, 80, 3), np.uint8))
    assert bad_frame(room).found == "a colour image of 80x60"


def test_depth_of_another_kind(room: Path) -> None:
    scene.image(room / "depth/00001.png", np.zeros((120, 160, 3), np.uint8))
    assert "uint8 with 3 channels" in bad_frame(room).found


def test_colour_and_depth_of_different_size(room: Path) -> None:
    for file in sorted((room / "depth").iterdir()):
        scene.image(file, np.zeros((60, 80), np.uint16))
    message = refused(room)
    assert "colour of 160x120 and depth of 80x60" in message
    assert "register depth to colour" in message


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ("1 2 3 4\n", "4 numbers"),
        ("130 0 79.5\n0 nan 59.5\n0 0 1\n", "NaN"),
        ("fx fy\n", "not numbers"),
        ("0 0 0\n0 0 0\n0 0 0\n", "0 0 0"),
        ("130 0 0\n0 130 0\n79.5 59.5 1\n", "130 0 0; 0 130 0; 79.5 59.5 1"),
    ],
)
def test_wrong_intrinsics(room: Path, content: str, found: str) -> None:
    (room / "intrinsics.txt").write_text(content)
    message = refused(room)
    assert message.startswith(str(room / "intrinsics.txt"))
    assert found in message


def test_missing_intrinsics(room: Path) -> None:
    (room / "intrinsics.txt").unlink()
    assert refused(room).startswith(str(room / "intrinsics.txt"))


@pytest.mark.parametrize(("folder", "found"), [("depth", "no depth images but 3 colour"), ("pose", "none")])
def test_a_part_is_missing(room: Path, folder: str, found: str) -> None:
    shutil.rmtree(room / folder)
    assert found in refused(room)


def test_depth_without_colour(room: Path) -> None:
    for file in sorted((room / "color").iterdir()):
        file.unlink()
    assert "no colour images but 3 depth images" in refused(room)


def test_numbers_that_do_not_match(room: Path) -> None:
    for file in sorted((room / "depth").iterdir()):
        file.rename(file.with_name(f"1{file.name}"))
    assert "no number in common" in refused(room)


@pytest.mark.parametrize(("write", "file"), [(formats.hololens, "poses.txt"), (formats.replica, "traj.txt")])
def test_count_of_poses(tmp_path: Path, write: Callable[[Path], Path], file: str) -> None:
    path = write(tmp_path / "room")
    lines = (path / file).read_text().splitlines()
    (path / file).write_text("\n".join(lines[:-1]))
    assert "expected 4 lines, one for each image, found 3 lines" in refused(path)
    (path / file).write_text("\n".join([*lines[:-1], "1 2 3"]))
    assert "line 4" in refused(path)


def test_tum_lists(tmp_path: Path) -> None:
    path = scene.write_tum(tmp_path / "room", count=3)
    right = (path / "groundtruth.txt").read_text()
    (path / "groundtruth.txt").write_text(right.replace("\n0.", "\n99."))
    assert "no common time" in refused(path)
    (path / "groundtruth.txt").write_text("0.0 1 2 3\n")
    assert "tx ty tz" in refused(path)
    (path / "groundtruth.txt").write_text("".join(f"{i / 30} 0 0 0 0 0 0 {i != 1:d}\n" for i in range(3)))
    assert bad_frame(path).found == "a quaternion not of unit length"
    (path / "groundtruth.txt").write_text("".join(f"{i / 30} 0 0 0 0 0 {'nan' * (i == 1) or 0} 1\n" for i in range(3)))
    assert bad_frame(path).found == "NaN or infinity in the pose"


def test_replica_camera(tmp_path: Path) -> None:
    path = formats.replica(tmp_path / "room")
    (path.parent / "cam_params.json").write_text("{}")
    assert "KeyError('camera')" in refused(path)
    (path.parent / "cam_params.json").write_text("not json")
    assert "cam_params.json" in refused(path)
    (path.parent / "cam_params.json").write_text(
        '{"camera": {"w": 1200, "h": 680, "fx": 600, "fy": 600, "cx": 599.5, "cy": 339.5, "scale": 6553.5}}'
    )
    assert "expected images of 1200x680, found images of 160x120" in refused(path)


def test_sens_that_ends_early_or_is_another_file(tmp_path: Path) -> None:
    (file,) = formats.scannet_sens(tmp_path / "room").iterdir()
    whole = file.read_bytes()
    for count in (5, 200, len(whole) // 2):
        file.write_bytes(whole[:count])
        assert "expected a whole .sens file" in refused(file)
    file.write_bytes(b"\x07" + whole[1:])
    assert "version 7" in refused(file)


def test_sens_with_damaged_depth(tmp_path: Path) -> None:
    (file,) = formats.scannet_sens(tmp_path / "room").iterdir()
    data = bytearray(file.read_bytes())
    data[-30:-8] = bytes(22)
    file.write_bytes(bytes(data))
    assert bad_frame(file, 3).found == "a truncated or unreadable image"


def test_3rscan_info_and_zip(tmp_path: Path) -> None:
    path = formats.three_rscan(tmp_path / "room")
    info = path / "sequence/_info.txt"
    info.write_text(info.read_text().replace("m_depthShift = 1000", "m_depthShift = none"))
    assert "m_depthShift = 1 numbers, found 'none'" in refused(path)
    broken = tmp_path / "other"
    broken.mkdir()
    (broken / "sequence.zip").write_bytes(b"PK nothing")
    assert "expected a zip file" in refused(broken)


def test_labels_and_instances(room: Path) -> None:
    (room / "labels.csv").write_text("id,label\n1,floor\n")
    assert "columns instance, name, thing" in refused(room)
    (room / "labels.csv").write_text("instance,name,thing\n1,floor,0\n")
    for i in range(3):
        scene.image(room / f"instance/{i:05d}.png", np.full((120, 160), 1 + 4 * (i == 1), np.uint16))
    assert "instance 5" in bad_frame(room).found


def test_stamps(room: Path) -> None:
    (room / "stamps.txt").write_text("1\n2\n")
    assert "expected 3 numbers, seconds" in refused(room)


def test_depth_that_is_not_finite_is_invalid(tmp_path: Path) -> None:
    path = formats.panmap_flat(tmp_path / "room")
    depth = scene.render(scene.pose(0))[1]
    depth[0, :3] = np.nan, np.inf, -1
    scene.image(path / "000000_depth.tiff", depth)
    assert open_sequence(path).frame(0).depth[0, :4].tolist()[:3] == [0, 0, 0]
