"""`uppm render`: what it writes is a sequence that our own readers read, and looks like what was mapped."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.conftest import Uppm
from tests.conftest import shared_data
from tests.datasets.scene import CAMERA
from uppm.core.config import Config
from uppm.core.geometry import resized
from uppm.core.types import SubmapKind
from uppm.map.raycast import Raycaster
from uppm.pipeline import map_sequence, open_map, open_sequence


def test_views_of_a_sequence_are_the_sequence(uppm: Uppm, map_file: Path, whole_room: Path, tmp_path: Path) -> None:
    folder = tmp_path / "views"
    done = uppm("render", map_file, "-o", folder, "--trajectory", whole_room, "--stride", 5)
    assert (done.code, done.out) == (0, f"{folder}: 3 views of {CAMERA.width}x{CAMERA.height}\n")
    views, room = open_sequence(folder), open_sequence(whole_room)
    assert views.raw.color == room.raw.color
    panoptic = open_map(map_file)
    for position, index in enumerate((0, 5, 10)):
        view, frame = views.frame(position), room.frame(index)
        np.testing.assert_allclose(view.T_map_camera, frame.T_map_camera, atol=1e-8)
        seen = (view.depth > 0) & (frame.depth > 0) & (frame.depth < 5)
        assert seen.sum() > 0.97 * ((frame.depth > 0) & (frame.depth < 5)).sum()
        assert np.median(np.abs(view.depth - frame.depth)[seen]) < 0.003
        assert view.truth is not None
        expected = Raycaster(panoptic).render(frame.T_map_camera, views.raw.color)
        np.testing.assert_array_equal(view.color, expected.color)
        np.testing.assert_allclose(view.depth, expected.depth, atol=5.1e-4)
        np.testing.assert_array_equal(view.truth.instance, np.where(expected.category > 0, expected.instance, 0))
        category = cv2.imread(str(folder / "category" / f"{index:05d}.png"), cv2.IMREAD_UNCHANGED)
        assert category is not None
        np.testing.assert_array_equal(category, expected.category)
    things = {s.id for s in panoptic.submaps if s.kind is SubmapKind.OBJECT}
    assert views.frame(0).truth.things == things  # pyright: ignore[reportOptionalMemberAccess]


def test_coco_panoptic_comes_back_as_a_front_end(uppm: Uppm, map_file: Path, whole_room: Path, tmp_path: Path) -> None:
    folder, segments = tmp_path / "views", tmp_path / "segments"
    done = uppm("render", map_file, "-o", folder, "--trajectory", whole_room, "--stride", 4, "--coco-panoptic")
    assert done.code == 0, done.err
    done = uppm("convert", "coco-panoptic", folder / "panoptic.json", "-o", segments)
    assert done.out.startswith(f"{segments}: 3 frames, ")
    assert "left out" not in done.out
    things = {s.id for s in open_map(map_file).submaps if s.kind is SubmapKind.OBJECT}
    for name in ("00000.png", "00004.png", "00008.png"):
        images = [cv2.imread(str(path / name), cv2.IMREAD_UNCHANGED) for path in (folder / "instance", segments)]
        instance, ids = (image for image in images if image is not None)
        np.testing.assert_array_equal(ids == 0, instance == 0)
        for thing in things & set(np.unique(instance).tolist()):
            np.testing.assert_array_equal(ids == ids[instance == thing][0], instance == thing)
    done = uppm("map", whole_room, "-o", tmp_path / "again.uppm", "--precomputed", segments, "--stride", 4)
    assert done.code == 0, done.err


@pytest.mark.parametrize("form", ["matrix", "kitti", "tum", "four lines"])
def test_poses_are_read_in_each_form(uppm: Uppm, map_file: Path, tmp_path: Path, form: str) -> None:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]], [0.1, -0.4, 0.2]
    lines = {
        "matrix": " ".join(map(str, pose.ravel())),
        "kitti": " ".join(map(str, pose[:3].ravel())),
        "tum": f"12.5 0.1 -0.4 0.2 {-(0.5**0.5)} 0 0 {0.5**0.5}",
        "four lines": "\n".join(" ".join(map(str, row)) for row in pose),
    }
    (tmp_path / "pose.txt").write_text(f"# one pose\n\n{lines[form]}\n")
    done = uppm("render", map_file, "-o", tmp_path / "v", "--pose", tmp_path / "pose.txt", "--size", "64", "48")
    assert done.code == 0, done.err
    np.testing.assert_allclose(open_sequence(tmp_path / "v").frame(0).T_map_camera, pose, atol=1e-7)


def test_cameras(uppm: Uppm, map_file: Path, whole_room: Path, tmp_path: Path) -> None:
    def camera(name: str, *options: object):
        done = uppm("render", map_file, "-o", tmp_path / name, *options)
        assert done.code == 0, done.err
        return open_sequence(tmp_path / name).raw.color

    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 0 0 0 1 0\n")
    (tmp_path / "K.txt").write_text("30 0 20\n0 31 15\n0 0 1\n")
    sequence, poses = ("--trajectory", whole_room, "--max-frames", 1), ("--trajectory", tmp_path / "poses.txt")
    half = resized(CAMERA, CAMERA.width // 2, CAMERA.height // 2)
    found = camera("half", *sequence, "--size", half.width, half.height)
    assert (found.fx, found.fy, found.cx, found.cy) == pytest.approx((half.fx, half.fy, half.cx, half.cy))
    plain = camera("plain", *poses, "--size", 64, 48, "--fov", 90)
    assert (plain.fx, plain.fy, plain.cx, plain.cy) == pytest.approx((32, 32, 31.5, 23.5))
    own = camera("own", *poses, "--size", 40, 30, "--intrinsics", tmp_path / "K.txt")
    assert (own.fx, own.fy, own.cx, own.cy, own.width, own.height) == (30, 31, 20, 15, 40, 30)
    assert len(open_sequence(tmp_path / "own")) == 2


def test_wrong_input_leaves_nothing(uppm: Uppm, map_file: Path, whole_room: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.txt").write_text("1 2 3\n")
    (tmp_path / "skew.txt").write_text("2 0 0 0 0 1 0 0 0 0 1 0\n")
    (tmp_path / "K.txt").write_text("30 0 20\n0 31 15\n0 0 1\n")
    (tmp_path / "there").mkdir()
    before, room = sorted(tmp_path.iterdir()), ("--trajectory", whole_room)
    for options, said in {
        (): "expected --pose or --trajectory, found neither",
        ("--pose", tmp_path / "bad.txt"): "expected lines of 8, 12 or 16 numbers, found 3 numbers in line 1",
        ("--pose", tmp_path / "skew.txt"): "expected a rigid 4x4 pose",
        ("--pose", tmp_path / "none.txt"): "expected a text file, found nothing there",
        (*room, "--intrinsics", tmp_path / "K.txt"): "expected an image size with the camera matrix, found none",
        (*room, "--depth-range", 3, 1): "expected 0 < least < greatest, found 3 to 1",
    }.items():
        done = uppm("render", map_file, "-o", tmp_path / "views", *options)
        assert done.code == 2
        assert said in done.err
    assert "expected a new folder" in uppm("render", map_file, "-o", tmp_path / "there", *room).err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.heavy
def test_views_of_the_flat_are_what_was_measured(tmp_path: Path) -> None:
    """The figures of docs/outputs.md, on half of the frames."""
    sequence = open_sequence(shared_data("data/flat/run1"), Config.load(None, ["input.stride=2"]).input)
    map_sequence(sequence, tmp_path / "flat.uppm", Config.load(None, ["perception.profile=groundtruth"]))
    caster = Raycaster(open_map(tmp_path / "flat.uppm"))
    errors, seen, pairs, names = [], [], [], {0: ""}
    for position in range(0, len(sequence), 9):
        frame = sequence.frame(position)
        assert frame.truth is not None
        names |= frame.truth.names
        view = caster.render(frame.T_map_camera, frame.intrinsics)
        valid = (frame.depth > 0) & (frame.depth < 5)
        both = valid & (view.depth > 0)
        seen.append(both.sum() / valid.sum())
        errors.append(np.abs(view.depth - frame.depth)[both])
        pairs.append(np.stack([view.instance[both], frame.truth.instance[both]], axis=1))
    found = np.concatenate(errors)
    assert np.median(found) < 0.001
    assert (found < 0.01).mean() > 0.86
    assert np.mean(seen) > 0.985
    assert agreement(np.concatenate(pairs), names) > 0.95


def agreement(pairs: np.ndarray, names: dict[int, str]) -> float:
    """Share of pixels (N, 2), submap and instance, whose submap's commonest instance is called as theirs."""
    rows, counts = np.unique(pairs[pairs[:, 1] > 0], axis=0, return_counts=True)
    right = 0
    for submap in np.unique(rows[:, 0]):
        own, count = rows[rows[:, 0] == submap, 1], counts[rows[:, 0] == submap]
        name = names[own[count.argmax()]]
        right += count[[names[n] == name for n in own]].sum()
    return right / counts.sum()
