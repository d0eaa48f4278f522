"""Pose conventions of files -> T_map_camera with OpenCV axes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError
from uppm.core.geometry import invert, pose_from_quaternion

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
