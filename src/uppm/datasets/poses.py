"""Pose conventions of files -> T_map_camera with OpenCV axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError, InputError
from uppm.core.geometry import invert, pose_from_quaternion
from uppm.core.validation import check_pose
from uppm.datasets import files

OPENGL_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])
"""T_opengl_opencv: x right, y up, z backward from x right, y down, z forward."""

Pose = npt.NDArray[np.float64]


def pose_matrix(raw: Pose, where: str, config: InputConfig) -> Pose:
    """T_map_camera (4, 4) of a file's pose: (4, 4), or (7,) of translation and quaternion.

    The rotation is made orthonormal where rounding in the file left it slightly off (the nearest rotation); one
    that is far off, or not finite, stays as it is, for the caller to judge.
    """
    pose = _from_quaternion(raw, where, config.quaternion_order) if raw.shape == (7,) else _orthonormal(raw)
    if config.invert_poses and np.isfinite(pose).all():
        pose = invert(pose)
    return pose @ OPENGL_CAMERA if config.pose_axes == "opengl" else pose


def read_trajectory(path: Path, config: InputConfig) -> list[Pose]:
    """T_map_camera (4, 4) of each line of a text file; empty lines and those that begin with # do not count.

    A line holds 8 numbers (time, translation, quaternion, as TUM's), 12 (three rows of the matrix, as KITTI's) or 16.
    One pose over four lines, as in a file of the `frames` layout, is read too.

    Raises
    ------
    InputError
        There is no such file, a line holds something else, or a pose is not finite and rigid.
    """
    lines = [line for line in files.read_text(path).splitlines() if line.strip() and not line.lstrip().startswith("#")]
    rows = [files.parse_numbers(line) for line in lines]
    if len(rows) == 4 and all(row is not None and len(row) == 4 for row in rows):
        rows, lines = [np.concatenate([row for row in rows if row is not None])], lines[:1]
    poses = []
    for number, row in enumerate(rows, 1):
        if row is None or len(row) not in (8, 12, 16):
            found = f"{'other text' if row is None else f'{len(row)} numbers'} in line {number}"
            advice = "see docs/outputs.md for the forms of a trajectory"
            raise InputError(path, expected="lines of 8, 12 or 16 numbers", found=found, advice=advice)
        raw = row[1:] if len(row) == 8 else np.append(row, [0, 0, 0, 1])[:16].reshape(4, 4)
        poses.append(pose_matrix(raw, f"{path}, line {number}", config))
        check_pose(f"{path}, line {number}", poses[-1])
    if not poses:
        raise InputError(path, expected="at least one pose", found="none", advice="write one a line")
    return poses


def _from_quaternion(raw: Pose, where: str, order: str) -> Pose:
    if not np.isfinite(raw).all():
        return np.full((4, 4), np.nan)
    norm = float(np.linalg.norm(raw[3:]))
    if not 0.9 < norm < 1.1:
        advice = "check the columns of the pose file"
        raise BadFrameError(where, expected="a unit quaternion", found="a quaternion not of unit length", advice=advice)
    return pose_from_quaternion(raw[:3], raw[3:] if order == "xyzw" else raw[[4, 5, 6, 3]])


def _orthonormal(pose: Pose) -> Pose:
    if not np.isfinite(pose).all():
        return pose
    R = pose[:3, :3]
    u, s, vt = np.linalg.svd(R)
    if np.abs(s - 1).max() > 1e-2 or np.linalg.det(R) < 0:
        return pose
    out = pose.copy()
    out[:3, :3] = u @ vt
    return out
