"""Each mistake is found and named with its fix; right data give no finding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.conftest import shared_data
from tests.datasets import scene
from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError
from uppm.core.geometry import invert
from uppm.datasets import PosedSequence, SequenceCheck, check_sequence, open_sequence
from uppm.datasets.poses import OPENGL_CAMERA


def check(root: Path, **options: object) -> SequenceCheck:
    return check_sequence(open_sequence(root, InputConfig.model_validate(options)))


def only(result: SequenceCheck) -> tuple[str, str, str]:
    assert len(result.findings) == 1, [str(finding) for finding in result.findings]
    finding = result.findings[0]
    return finding.kind, finding.text, finding.fix


def test_right_data_have_no_finding(tmp_path: Path) -> None:
    result = check(scene.write_frames(tmp_path / "room"))
    assert result.ok
    assert result.agreement_cm < 0.5
    assert min(result.candidates.values()) > 2
    assert (result.frames, result.frames_read, result.unreadable) == (scene.FRAMES, scene.FRAMES, {})


@pytest.mark.parametrize(
    ("stored", "fix"),
    [
        (lambda i, T: invert(T), "use --invert-poses"),
        (lambda i, T: T @ OPENGL_CAMERA, "use --pose-axes opengl"),
        (lambda i, T: invert(T @ OPENGL_CAMERA), "use --invert-poses and --pose-axes opengl"),
    ],
)
def test_pose_conventions(tmp_path: Path, stored, fix: str) -> None:
    root = scene.write_frames(tmp_path / "room", stored=stored)
    kind, text, found = only(check(root))
    assert (kind, found) == ("poses", fix)
    assert text.startswith("poses look ")
    assert "as given" in text


def test_the_fix_mends_it_and_its_opposite_is_found(tmp_path: Path) -> None:
    root = scene.write_frames(tmp_path / "room", stored=lambda i, T: invert(T @ OPENGL_CAMERA))
    assert check(root, invert_poses=True, pose_axes="opengl").ok
    right = scene.write_frames(tmp_path / "right")
    kind, _, fix = only(check(right, invert_poses=True))
    assert (kind, fix) == ("poses", "drop --invert-poses")


@pytest.mark.parametrize(("units", "fix"), [(5000, "use --depth-scale 5000"), (6553.5, "use --depth-scale 6553.5")])
def test_depth_scale_of_the_file(tmp_path: Path, units: float, fix: str) -> None:
    root = scene.write_frames(tmp_path / "room", units=units)
    kind, _, found = only(check(root))
    assert (kind, found) == ("depth-scale", fix)


@pytest.mark.parametrize("scale", [1.0, 5000.0, 1e6])
def test_depth_scale_of_the_option(tmp_path: Path, scale: float) -> None:
    kind, _, fix = only(check(scene.write_frames(tmp_path / "room"), depth_scale=scale))
    assert (kind, fix) == ("depth-scale", "use --depth-scale 1000")


def test_depth_scale_without_motion_is_seen_by_its_range(tmp_path: Path) -> None:
    root = scene.write_frames(tmp_path / "room", stored=lambda i, T: scene.pose(0))
    for i in range(scene.FRAMES):
        (root / f"depth/{i:05d}.png").write_bytes((root / "depth/00000.png").read_bytes())
    kind, text, fix = only(check(root, depth_scale=1.0))
    assert (kind, fix) == ("depth-scale", "use --depth-scale 1000")
    assert "median depth" in text


@pytest.mark.parametrize("factor", [0.5, 2.0, 1.5])
def test_intrinsics_of_another_resolution(tmp_path: Path, factor: float) -> None:
    K = np.diag([factor, factor, 1.0]) @ scene.CAMERA.matrix
    K[:2, 2] += (factor - 1) / 2
    kind, text, fix = only(check(scene.write_frames(tmp_path / "room", K=K)))
    assert kind == "intrinsics"
    assert f"{160 * factor:.0f}x{120 * factor:.0f}" in text
    assert "fx 130.0, fy 130.0, cx 79.5, cy 59.5" in fix


def test_two_mistakes_at_once(tmp_path: Path) -> None:
    root = scene.write_frames(tmp_path / "room", stored=lambda i, T: invert(T), units=5000)
    kind, _, fix = only(check(root))
    assert (kind, fix) == ("poses+depth-scale", "use --invert-poses and --depth-scale 5000")


def test_quaternion_order(tmp_path: Path) -> None:
    assert check(scene.write_tum(tmp_path / "right")).ok
    root = scene.write_tum(tmp_path / "wrong", order="wxyz")
    kind, _, fix = only(check(root))
    assert (kind, fix) == ("poses", "use --quaternion-order wxyz")
    assert check(root, quaternion_order="wxyz").ok


def test_nan_pose_and_truncated_and_missing_files_are_counted(tmp_path: Path) -> None:
    root = scene.write_frames(tmp_path / "room")
    (root / "pose/00003.txt").write_text(scene.text(np.full((4, 4), np.nan)))
    whole = (root / "depth/00005.png").read_bytes()
    (root / "depth/00005.png").write_bytes(whole[: len(whole) // 2])
    (root / "color/00008.png").unlink()
    result = check(root)
    kind, text, _ = only(result)
    assert kind == "unreadable"
    assert "3 of 16 frames" in text
    assert dict(result.unreadable) == {
        "NaN or infinity in the pose": 1,
        "a truncated or unreadable image": 1,
        "a missing file": 1,
    }
    with pytest.raises(BadFrameError, match="00003"):
        check(root, strict=True)


def test_a_jump_that_the_images_do_not_follow(tmp_path: Path) -> None:
    def stored(i: int, T: np.ndarray) -> np.ndarray:
        return np.array([[1, 0, 0, 0.9], [0, 1, 0, 0.7], [0, 0, 1, 0], [0, 0, 0, 1.0]]) @ T if i >= 8 else T

    kind, text, _ = only(check(scene.write_frames(tmp_path / "room", stored=stored)))
    assert kind == "jump"
    assert "between frames 7 and 8" in text


def test_identical_poses(tmp_path: Path) -> None:
    kind, _, fix = only(check(scene.write_frames(tmp_path / "room", stored=lambda i, T: np.eye(4))))
    assert (kind, fix) == ("still", "give each frame its pose")


def test_a_still_camera_is_right(tmp_path: Path) -> None:
    root = scene.write_frames(tmp_path / "room", stored=lambda i, T: scene.pose(0))
    for i in range(scene.FRAMES):
        (root / f"depth/{i:05d}.png").write_bytes((root / "depth/00000.png").read_bytes())
    assert check(root).ok


def test_poses_of_other_frames_are_inconsistent(tmp_path: Path) -> None:
    order = np.random.default_rng(0).permutation(scene.FRAMES)
    result = check(scene.write_frames(tmp_path / "room", stored=lambda i, T: scene.pose(int(order[i]))))
    assert "inconsistent" in {finding.kind for finding in result.findings}


def test_a_single_frame_cannot_be_judged(tmp_path: Path) -> None:
    result = check(scene.write_frames(tmp_path / "room", count=1))
    assert result.ok
    assert result.pairs == 0
    assert np.isnan(result.agreement_cm)


def test_a_bad_frame_beside_a_jump_is_counted_once(tmp_path: Path) -> None:
    def stored(i: int, T: np.ndarray) -> np.ndarray:
        return np.array([[1, 0, 0, 0.9], [0, 1, 0, 0.7], [0, 0, 1, 0], [0, 0, 0, 1.0]]) @ T if i >= 8 else T

    root = scene.write_frames(tmp_path / "room", stored=stored)
    (root / "depth/00008.png").unlink()
    result = check(root)
    assert dict(result.unreadable) == {"a missing file": 1}
    assert result.frames_read == scene.FRAMES - 1


@pytest.mark.parametrize("name", ["flat/run1", "flat/run2", "7scenes-kitchen", "hololens-office"])
def test_recorded_sequences(name: str) -> None:
    raw = open_sequence(shared_data(f"data/{name}")).raw
    right = check_sequence(PosedSequence(raw), quick=True)
    assert right.ok, [str(finding) for finding in right.findings]
    assert right.agreement_cm < 1.2
    assert right.frames_read <= 36
    wrong = check_sequence(PosedSequence(raw, InputConfig(invert_poses=True)), quick=True)
    assert [finding.fix for finding in wrong.findings] == ["drop --invert-poses"]
    wrong = check_sequence(PosedSequence(raw, InputConfig(depth_scale=5000)), quick=True)
    assert [finding.fix for finding in wrong.findings] == ["use --depth-scale 1000"]
