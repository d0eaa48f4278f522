"""Each format gives back the room's colour, depth and poses; the input options act alike on all."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import shared_data
from tests.datasets import formats, scene
from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError, InputError
from uppm.core.geometry import invert
from uppm.datasets import PosedSequence, open_sequence, truth_surface
from uppm.datasets.poses import OPENGL_CAMERA
from uppm.datasets.registry import READERS

INTERVALS = {"scannet sens": 0.033333, "panmap-flat": 0.1, "hololens": 4 / 30, "bag": 0.1}


@pytest.mark.parametrize("name", formats.FORMATS)
def test_a_format_is_found_and_read(name: str, tmp_path: Path) -> None:
    write, expected = formats.FORMATS[name]
    source = open_sequence(write(tmp_path / "room"))
    assert source.raw.format == expected
    assert len(source) == formats.COUNT
    for i in range(formats.COUNT):
        frame = source.frame(i)
        color, depth = scene.render(scene.pose(i))
        assert frame.index == i
        assert np.allclose(frame.T_map_camera, scene.pose(i), atol=1e-6)
        assert frame.intrinsics == scene.CAMERA
        assert np.abs(frame.color.astype(int) - color).mean() < 4
        seen = frame.depth > 0
        assert seen.mean() > 0.9
        assert np.median(np.abs(frame.depth - depth)[seen]) < 2e-3
        assert np.percentile(np.abs(frame.depth - depth)[seen], 90) < 0.02
    assert source.frame(1).stamp - source.frame(0).stamp == pytest.approx(INTERVALS.get(name, 1 / 30), abs=1e-6)


@pytest.mark.parametrize("name", formats.FORMATS)
def test_a_format_can_be_named(name: str, tmp_path: Path) -> None:
    write, expected = formats.FORMATS[name]
    path = write(tmp_path / "room")
    assert open_sequence(path, InputConfig(format=expected)).raw.format == expected
    other = "tum" if expected != "tum" else "replica"
    with pytest.raises(InputError):
        open_sequence(path, InputConfig(format=other))


def test_every_reader_is_tested() -> None:
    assert {expected for _, expected in formats.FORMATS.values()} == set(READERS)


@pytest.mark.parametrize("name", ["scannet sens", "3rscan zip"])
def test_the_file_itself_can_be_given(name: str, tmp_path: Path) -> None:
    folder = formats.FORMATS[name][0](tmp_path / "room")
    (file,) = folder.iterdir()
    assert len(open_sequence(file)) == formats.COUNT


def test_stride_keeps_positions(tmp_path: Path) -> None:
    path = scene.write_frames(tmp_path / "room", count=8)
    source = open_sequence(path, InputConfig(stride=3))
    assert [source.frame(i).index for i in range(len(source))] == [0, 3, 6]
    assert len(open_sequence(path, InputConfig(stride=3, max_frames=2))) == 2
    with pytest.raises(IndexError):
        source.frame(3)


@pytest.mark.parametrize(
    ("stored", "options"),
    [
        (lambda i, T: invert(T), {"invert_poses": True}),
        (lambda i, T: T @ OPENGL_CAMERA, {"pose_axes": "opengl"}),
        (lambda i, T: invert(T @ OPENGL_CAMERA), {"invert_poses": True, "pose_axes": "opengl"}),
    ],
)
def test_pose_options(tmp_path: Path, stored, options: dict[str, object]) -> None:
    path = scene.write_frames(tmp_path / "room", count=2, stored=stored)
    pose = open_sequence(path, InputConfig.model_validate(options)).pose(1)
    assert np.allclose(pose, scene.pose(1), atol=1e-6)


def test_quaternion_order_and_depth_scale(tmp_path: Path) -> None:
    path = scene.write_tum(tmp_path / "room", order="wxyz", count=2)
    source = open_sequence(path, InputConfig(quaternion_order="wxyz", depth_scale=2500))
    assert np.allclose(source.pose(1), scene.pose(1), atol=1e-6)
    assert np.allclose(source.frame(1).depth, 2 * scene.render(scene.pose(1))[1], atol=1e-3)


def test_tum_drops_images_without_a_pose_in_time(tmp_path: Path) -> None:
    path = scene.write_tum(tmp_path / "room", count=6)
    lines = (path / "groundtruth.txt").read_text().splitlines()
    (path / "groundtruth.txt").write_text("\n".join(lines[:3] + lines[4:]) + "\n")
    source = open_sequence(path)
    assert len(source) == 5
    assert np.allclose(source.pose(2), scene.pose(3), atol=1e-6)


@pytest.mark.parametrize(("camera", "fx"), [("freiburg1", 517.3), ("freiburg2", 520.9), ("freiburg3", 535.4)])
def test_tum_cameras_by_name(tmp_path: Path, camera: str, fx: float) -> None:
    path = scene.write_tum(tmp_path / f"rgbd_dataset_{camera}_desk", count=1)
    (path / "intrinsics.txt").unlink()
    with pytest.raises(InputError, match="160x120"):
        open_sequence(path)
    scene.image(path / "rgb/0.png", np.zeros((480, 640, 3), np.uint8))
    scene.image(path / "depth/0.png", np.zeros((480, 640), np.uint16))
    assert open_sequence(path).raw.color.fx == fx


def test_sens_frames_with_an_infinite_pose_are_bad(tmp_path: Path) -> None:
    source = open_sequence(formats.scannet_sens(tmp_path / "room", lost=2))
    assert source.frame(1).index == 1
    with pytest.raises(BadFrameError, match="frame 2: expected a finite 4x4 pose"):
        source.frame(2)


def test_7scenes_65535_is_invalid(tmp_path: Path) -> None:
    depth = open_sequence(formats.seven_scenes(tmp_path / "room")).frame(0).depth
    assert not depth[:4].any()
    assert depth[4:].all()


def test_panmap_flat_truth(tmp_path: Path) -> None:
    truth = open_sequence(formats.panmap_flat(tmp_path / "room")).frame(0).truth
    assert truth is not None
    assert truth.names == {7: "wall", 9: "chair"}
    assert truth.things == {9}
    assert set(np.unique(truth.instance)) == {7, 9}


def test_frames_truth_surface_and_stamps(tmp_path: Path) -> None:
    path = scene.write_frames(tmp_path / "room", count=2)
    assert open_sequence(path).frame(0).truth is None
    assert truth_surface(path) is None
    (path / "labels.csv").write_text("instance,name,thing,categories\n1,floor,0,floor-other\n2,ball,1,sports ball\n")
    for i in range(2):
        scene.image(path / f"instance/{i:05d}.png", np.full((120, 160), 2 * i, np.uint16))
    (path / "stamps.txt").write_text("10.5\n11\n")
    np.savez(path / "surface.npz", xyz_mm=np.array([[1000, -20, 3]], np.int16), instance=np.array([2], np.uint16))
    frame = open_sequence(path).frame(1)
    assert frame.truth is not None
    assert (frame.truth.names, frame.truth.things, frame.stamp) == ({1: "floor", 2: "ball"}, {2}, 11.0)
    assert (frame.truth.instance == 2).all()
    surface = truth_surface(path)
    assert surface is not None
    assert np.allclose(surface[0], [[1.0, -0.02, 0.003]])
    assert surface[1].tolist() == [2]


def test_frames_with_a_depth_camera_of_its_own_are_registered(tmp_path: Path) -> None:
    path = scene.write_frames(tmp_path / "room", count=2)
    for i in range(2):
        scene.image(path / f"depth/{i:05d}.png", formats.depth_camera(i))
    (path / "depth_intrinsics.txt").write_text(scene.text(formats.DEPTH_CAMERA.matrix))
    (path / "T_color_depth.txt").write_text(scene.text(formats.T_COLOR_DEPTH))
    depth = open_sequence(path).frame(1).depth
    error = np.abs(depth - scene.render(scene.pose(1))[1])[depth > 0]
    assert depth.shape == (120, 160)
    assert np.median(error) < 2e-3


def test_reading_is_independent_of_the_working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = scene.write_frames(tmp_path / "room", count=1)
    monkeypatch.chdir(path)
    assert open_sequence(".").name == "room"


def test_recorded_truth() -> None:
    source = open_sequence(shared_data("data/flat/run1"))
    frame = source.frame(0)
    assert frame.truth is not None
    assert len(source) == 180
    assert frame.truth.instance.shape == frame.depth.shape
    assert frame.truth.names[1] == "floor"
    assert 1 not in frame.truth.things
    surface = truth_surface(shared_data("data/flat/run1"))
    assert surface is not None
    assert surface[0].shape == (len(surface[1]), 3)


def test_recorded_7scenes_without_its_intrinsics_file(tmp_path: Path) -> None:
    for file in sorted(shared_data("data/7scenes-kitchen").glob("frame-000000.*")):
        shutil.copyfile(file, tmp_path / file.name)
    source = open_sequence(tmp_path)
    assert isinstance(source, PosedSequence)
    assert source.raw.color.matrix.tolist() == [[585, 0, 320], [0, 585, 240], [0, 0, 1]]
