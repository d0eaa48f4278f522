"""Rigid transforms and the pinhole model on arrays; every stage's geometry comes from here."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from uppm.core.types import Intrinsics

Points = npt.NDArray[np.float64]
Pose = npt.NDArray[np.float64]


def invert(T_a_b: Pose) -> Pose:
    """T_b_a of a rigid T_a_b (4, 4)."""
    T_b_a = np.eye(4)
    T_b_a[:3, :3] = T_a_b[:3, :3].T
    T_b_a[:3, 3] = -T_a_b[:3, :3].T @ T_a_b[:3, 3]
    return T_b_a


def transform(T_a_b: Pose, points_b: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """Points (..., 3) of frame b in frame a."""
    return points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def level_axes(up: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Two level unit vectors (3,) that make a right-handed frame with a unit vector up (3,)."""
    side = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))]).astype(np.float64)
    side /= np.linalg.norm(side)
    return side, np.cross(up, side).astype(np.float64)


def upright(up: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Rotation (3, 3) that takes `up` to +z by the shortest way."""
    axis, cosine = np.cross(up, [0.0, 0.0, 1.0]), float(up[2])
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + skew + skew @ skew / (1 + cosine)


def pose_from_quaternion(translation: npt.ArrayLike, xyzw: npt.ArrayLike) -> Pose:
    """(4, 4) pose of a translation (3,) and a quaternion (4,) in order x, y, z, w, normalised here."""
    q = np.asarray(xyzw, dtype=np.float64)
    x, y, z, w = q / np.linalg.norm(q)
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = np.asarray(translation, dtype=np.float64)
    return pose


def rays(intrinsics: Intrinsics) -> npt.NDArray[np.float32]:
    """(H, W, 3): the point at z = 1 m of each pixel, frame camera."""
    u = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    v = (np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy
    out = np.ones((intrinsics.height, intrinsics.width, 3), dtype=np.float32)
    out[..., 0], out[..., 1] = u[None, :], v[:, None]
    return out


def backproject(depth: npt.NDArray[np.float32], intrinsics: Intrinsics) -> npt.NDArray[np.float32]:
    """Points (H, W, 3) of a depth image (H, W), frame camera, metres; 0 where the depth is invalid."""
    return rays(intrinsics) * depth[..., None]


def project(points: npt.NDArray[np.floating], intrinsics: Intrinsics) -> npt.NDArray[np.float64]:
    """Pixel coordinates (..., 2) of points (..., 3) in frame camera with z > 0."""
    z = points[..., 2]
    u = intrinsics.fx * points[..., 0] / z + intrinsics.cx
    v = intrinsics.fy * points[..., 1] / z + intrinsics.cy
    return np.stack([u, v], axis=-1)


def rotation_angle(T_a_b: Pose) -> float:
    """Angle of a pose's rotation, radians."""
    return float(np.arccos(np.clip((np.trace(T_a_b[:3, :3]) - 1) / 2, -1, 1)))


def resized(intrinsics: Intrinsics, width: int, height: int) -> Intrinsics:
    """The same camera with images of another size; pixel centres are integers."""
    across, down = width / intrinsics.width, height / intrinsics.height
    return Intrinsics(
        fx=intrinsics.fx * across,
        fy=intrinsics.fy * down,
        cx=(intrinsics.cx + 0.5) * across - 0.5,
        cy=(intrinsics.cy + 0.5) * down - 0.5,
        width=width,
        height=height,
    )
