"""`uppm live` on stand-ins for the cameras' drivers: they give the rendered room, and do nothing else of the hardware.

That the command works with a real camera is not shown here.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import uppm as package
from tests.cli.conftest import Uppm
from tests.datasets.formats import quaternion_first
from tests.datasets.scene import CAMERA, pose, quaternion, render
from uppm.core.geometry import invert, pose_from_quaternion
from uppm.core.types import Intrinsics
from uppm.map.shown import content_of

COUNT = 3
START = 1_700_000_000.0
HALF = Intrinsics(fx=65, fy=65, cx=39.5, cy=29.5, width=80, height=60)
T_BODY_CAMERA = pose_from_quaternion([0.1, 0.0, 0.2], [-0.5, 0.5, -0.5, 0.5])
BLOCK = ("--policy", "block", "--set", "fusion.max_blocks=20000")


def module(monkeypatch: pytest.MonkeyPatch, name: str, **contents: Any) -> ModuleType:
    made = ModuleType(name)
    vars(made).update(contents)
    monkeypatch.setitem(sys.modules, name, made)
    return made


class StandInRecord3D:
    """What is used of record3d.Record3DStream; the next frame comes when the last one's pose was read."""

    devices: list[str] = ["a phone"]  # noqa: RUF012
    kind, connects = 1, True

    def __init__(self) -> None:
        self.n = 0
        self.on_new_frame: Callable[[], None] = lambda: None
        self.on_stream_stopped: Callable[[], None] = lambda: None

    @classmethod
    def get_connected_devices(cls) -> list[str]:
        return cls.devices

    def connect(self, device: str) -> bool:
        self.on_new_frame()
        return self.connects

    def disconnect(self) -> None: ...

    def get_device_type(self) -> int:
        return self.kind

    def get_rgb_frame(self) -> np.ndarray:
        return render(pose(self.n))[0]

    def get_depth_frame(self) -> np.ndarray:
        return render(pose(self.n), HALF)[1]

    def get_confidence_frame(self) -> np.ndarray:
        return np.full((60, 80), 2, np.uint8)

    def get_intrinsic_mat(self) -> SimpleNamespace:
        return SimpleNamespace(fx=CAMERA.fx, fy=CAMERA.fy, tx=CAMERA.cx, ty=CAMERA.cy)

    def get_camera_pose(self) -> SimpleNamespace:
        values = quaternion_first(pose(self.n))
        self.n += 1
        (self.on_new_frame if self.n < COUNT else self.on_stream_stopped)()
        return SimpleNamespace(**dict(zip(("qx", "qy", "qz", "qw", "tx", "ty", "tz"), values, strict=True)))


def assert_the_room(path: Path, stamps: list[float]) -> None:
    found = package.open_map(path)
    assert found.report.frames == len(stamps)
    for i, record in enumerate(found.frames):
        assert record.T_map_camera is not None
        np.testing.assert_allclose(record.T_map_camera, pose(i), atol=1e-6)
        assert record.stamp == pytest.approx(stamps[i], abs=1e-3)
    vertices = found.mesh().vertices
    assert np.percentile(np.abs(vertices), 99, axis=0) == pytest.approx([3.0, 2.5, 1.4], abs=0.4)


def test_record3d_is_mapped(uppm: Uppm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module(monkeypatch, "record3d", Record3DStream=StandInRecord3D)
    path = tmp_path / "room.uppm"
    done = uppm("live", "record3d", "-o", path, *BLOCK)
    assert (done.code, done.err) == (0, "")
    assert f"{path}: {COUNT} frames mapped, 0 skipped, 0 dropped; latency" in done.out
    assert_the_room(path, [i / 30 for i in range(COUNT)])


def test_a_running_camera_in_the_browser(uppm: Uppm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page is served from the start, and afterwards until Ctrl-C, which comes at once here."""
    pytest.importorskip("viser", reason="the viewer is not installed (pip install uppm[view])")
    module(monkeypatch, "record3d", Record3DStream=StandInRecord3D)
    kept: list[list[str]] = []

    def until_interrupted(served: Any, say: Callable[[], None]) -> None:
        say()
        kept.append(sorted(s.name for s in served.nodes.shown.values()))
        served.close()

    monkeypatch.setattr("uppm.cli.view.until_interrupted", until_interrupted)
    path = tmp_path / "room.uppm"
    done = uppm("live", "record3d", "-o", path, *BLOCK, "--view", "--view-port", 0)
    assert done.code == 0
    first, last = done.err.splitlines()
    assert first.startswith("http://127.0.0.1:")
    assert last == f"{first}  shows the finished map (Ctrl-C ends)"
    assert kept == [sorted(s.name for s in content_of(package.open_map(path), "").shown)]
    assert kept[0]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"devices": []}, "expected an iPhone or iPad that streams, found none; connect it by USB"),
        ({"connects": False}, "expected a device that streams, found one that does not"),
        ({"kind": 0}, "expected poses, found the front camera, which has none"),
    ],
)
def test_a_phone_that_does_not_stream(
    uppm: Uppm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: dict[str, Any], said: str
) -> None:
    module(monkeypatch, "record3d", Record3DStream=type("Other", (StandInRecord3D,), changed))
    done = uppm("live", "record3d", "-o", tmp_path / "room.uppm")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert said in done.err
    assert list(tmp_path.iterdir()) == []


class StandInImage:
    """A video frame of the driver."""

    def __init__(self, pixels: np.ndarray, stamp: float, form: str) -> None:
        self.pixels, self.stamp, self.form = pixels, stamp, form

    def get_data(self) -> np.ndarray:
        return self.pixels

    def get_timestamp(self) -> float:
        return 1000 * self.stamp

    def get_profile(self) -> StandInImage:
        return self

    as_video_stream_profile = get_profile

    def format(self) -> str:
        return self.form

    def get_intrinsics(self) -> SimpleNamespace:
        c = CAMERA
        return SimpleNamespace(fx=c.fx, fy=c.fy, ppx=c.cx, ppy=c.cy, width=c.width, height=c.height)


class StandInPipeline:
    """Colour in bgr8 and depth in tenths of a millimetre, one frame a tenth of a second."""

    def __init__(self) -> None:
        self.n = 0

    def start(self, config: SimpleNamespace) -> StandInPipeline:
        if config.file and not Path(config.file).exists():
            raise RuntimeError("Failed to resolve request")
        return self

    def get_device(self) -> SimpleNamespace:
        sensor = SimpleNamespace(get_depth_scale=lambda: 1e-4)
        playback = SimpleNamespace(set_real_time=lambda real: None)
        return SimpleNamespace(first_depth_sensor=lambda: sensor, as_playback=lambda: playback)

    def try_wait_for_frames(self, timeout: int) -> tuple[bool, SimpleNamespace | None]:
        if self.n == COUNT:
            return False, None
        color, depth = render(pose(self.n))
        stamp = START + self.n / 10
        self.n += 1
        images = StandInImage(color[..., ::-1], stamp, "bgr8"), StandInImage((1e4 * depth).astype("u2"), stamp, "z16")
        return True, SimpleNamespace(get_color_frame=lambda: images[0], get_depth_frame=lambda: images[1])

    def stop(self) -> None: ...


def stand_in_config() -> SimpleNamespace:
    made = SimpleNamespace(file=None, enable_stream=lambda *what: None)
    made.enable_device_from_file = lambda file, repeat: setattr(made, "file", file)
    made.resolve = lambda pipeline: pipeline.start(made)
    return made


@pytest.fixture
def realsense(monkeypatch: pytest.MonkeyPatch) -> None:
    module(
        monkeypatch,
        "pyrealsense2",
        pipeline=StandInPipeline,
        pipeline_wrapper=lambda pipeline: pipeline,
        config=stand_in_config,
        align=lambda to: SimpleNamespace(process=lambda frames: frames),
        stream=SimpleNamespace(color="color", depth="depth"),
        format=SimpleNamespace(rgb8="rgb8", bgr8="bgr8", z16="z16"),
    )


def row(time: float, T: np.ndarray) -> str:
    return f"{time} {' '.join(map(str, (*T[:3, 3], *quaternion(T))))}\n"


@pytest.mark.usefixtures("realsense")
def test_realsense_with_poses_of_a_file(uppm: Uppm, tmp_path: Path) -> None:
    poses, extrinsics, path = tmp_path / "poses.txt", tmp_path / "T.txt", tmp_path / "room.uppm"
    body = [pose(i) @ invert(T_BODY_CAMERA) for i in range(COUNT)]
    poses.write_text("".join(row(START + i / 10, body[i]) for i in range(COUNT - 1)))
    np.savetxt(extrinsics, T_BODY_CAMERA)
    done = uppm("live", "realsense", "-o", path, "--poses", poses, "--camera-on-body", extrinsics, *BLOCK)
    assert (done.code, done.err) == (0, "")
    assert "2 frames mapped, 0 skipped, 0 dropped" in done.out
    assert done.out.endswith(", 1 without a pose\n")
    assert_the_room(path, [START, START + 0.1])


@pytest.mark.usefixtures("realsense")
def test_realsense_with_poses_of_a_topic(uppm: Uppm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kind, node = type("PoseStamped", (), {}), StandInListener()
    module(monkeypatch, "geometry_msgs")
    module(monkeypatch, "geometry_msgs.msg", PoseStamped=kind)
    module(
        monkeypatch, "rclpy", ok=lambda: False, init=lambda: None, create_node=lambda name: node, spin_once=node.spin
    )
    path = tmp_path / "room.uppm"
    done = uppm("live", "realsense", "-o", path, "--pose-topic", "/pose", "--frames", "2", *BLOCK)
    assert (done.code, done.err) == (0, "")
    assert node.kind is kind
    assert_the_room(path, [START, START + 0.1])


class StandInListener:
    """What is used of an rclpy node: a topic that tells the next pose, 0.05 s after the last, each time it spins."""

    def __init__(self) -> None:
        self.told, self.kind, self.callback = 0, None, None

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return [("/pose", ["geometry_msgs/msg/PoseStamped"])]

    def create_subscription(self, kind: type, topic: str, callback: Callable[[Any], None], depth: int) -> None:
        self.kind, self.callback = kind, callback

    def spin(self, node: StandInListener, timeout_sec: float) -> None:
        if self.callback is None:
            return
        T, time = pose(self.told / 2), START + self.told / 20
        place = SimpleNamespace(**dict(zip("xyz", T[:3, 3], strict=True)))
        turn = SimpleNamespace(**dict(zip("xyzw", quaternion(T), strict=True)))
        stamp = SimpleNamespace(sec=int(time), nanosec=round((time - int(time)) * 1e9))
        self.told += 1
        self.callback(
            SimpleNamespace(header=SimpleNamespace(stamp=stamp), pose=SimpleNamespace(position=place, orientation=turn))
        )


@pytest.mark.usefixtures("realsense")
def test_wrong_input_is_one_line(uppm: Uppm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    poses = tmp_path / "poses.txt"
    poses.write_text(row(START, pose(0)))
    monkeypatch.setitem(sys.modules, "rclpy", None)
    for arguments, said in (
        (("realsense",), "expected --poses or --pose-topic, found neither"),
        (("realsense", "--poses", poses, "--pose-topic", "/odom"), "expected --poses or --pose-topic, found both"),
        (("realsense", "--poses", tmp_path / "none.txt"), "none.txt: expected a text file, found nothing there"),
        (
            ("realsense", "--poses", poses, "--recording", tmp_path / "walk.bag"),
            "walk.bag: expected colour and depth, found Failed to resolve request",
        ),
        (("realsense", "--pose-topic", "/odom"), "rclpy, which listens to a topic, is not installed"),
    ):
        done = uppm("live", *arguments, "-o", tmp_path / "room.uppm")
        assert (done.code, done.err.count("\n")) == (2, 1), done.err
        assert said in done.err
    assert not (tmp_path / "room.uppm").exists()


def test_without_the_drivers_the_command_is_named(uppm: Uppm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "poses.txt").write_text(row(START, pose(0)))
    for arguments, driver, extra in (
        (("record3d",), "record3d", "record3d-live"),
        (("realsense", "--poses", tmp_path / "poses.txt"), "pyrealsense2", "realsense"),
    ):
        monkeypatch.setitem(sys.modules, driver, None)
        done = uppm("live", *arguments, "-o", tmp_path / "room.uppm")
        assert (done.code, done.err.count("\n")) == (2, 1)
        assert f"is not installed; run: pip install uppm[{extra}]" in done.err
