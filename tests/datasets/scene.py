"""A room with two balls, seen by a moving camera: exact depths and poses, written in any of the formats."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.geometry import pose_from_quaternion, rays
from uppm.core.types import Intrinsics

CAMERA = Intrinsics(fx=130, fy=130, cx=79.5, cy=59.5, width=160, height=120)
HALF = np.array([3.0, 2.5, 1.4])
"""Half the room's size, metres."""
BALLS = ((np.array([1.6, 0.3, -0.7]), 0.6), (np.array([0.9, 1.4, 0.2]), 0.4))
"""Centres and radii, metres."""
FRAMES = 16

Array = npt.NDArray[np.float64]


def pose(t: float) -> Array:
    """T_map_camera after `t` frames: it walks, turns and nods."""
    yaw, position = -0.2 + 0.07 * t, np.array([-1.5 + 0.06 * t, -0.8 + 0.04 * t, 0.1 * np.sin(0.4 * t)])
    forward = np.array([np.cos(yaw), np.sin(yaw), -0.15 + 0.1 * np.sin(0.3 * t)])
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    out = np.eye(4)
    out[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=-1)
    out[:3, 3] = position
    return out


def render(T_map_camera: Array, camera: Intrinsics = CAMERA) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
    """(H, W, 3) colour and (H, W) depth in metres."""
    directions = rays(camera).astype(np.float64) @ T_map_camera[:3, :3].T
    origin = T_map_camera[:3, 3]
    with np.errstate(divide="ignore"):
        depth = ((np.sign(directions) * HALF - origin) / directions).min(axis=-1)
    for centre, radius in BALLS:
        depth = np.minimum(depth, _ball(directions, origin - centre, radius))
    points = origin + directions * depth[..., None]
    color = (127 + 120 * np.sin(points * [5.0, 7.0, 9.0])).astype(np.uint8)
    return color, depth.astype(np.float32)


def _ball(directions: Array, offset: Array, radius: float) -> Array:
    a, b = (directions**2).sum(-1), directions @ offset
    square = b * b - a * (offset @ offset - radius**2)
    near = (-b - np.sqrt(np.maximum(square, 0))) / a
    return np.where((square > 0) & (near > 0), near, np.inf)


def quaternion(T: Array) -> Array:
    """x, y, z, w of a pose's rotation, with w > 0, checked against the package's own inverse."""
    w = np.sqrt(max(1 + np.trace(T[:3, :3]), 1e-12)) / 2
    R = T[:3, :3]
    xyzw = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 4 * w * w]) / (4 * w)
    assert np.allclose(pose_from_quaternion(T[:3, 3], xyzw), T, atol=1e-6)
    return xyzw


def text(array: npt.ArrayLike) -> str:
    return "\n".join(" ".join(f"{value:.9g}" for value in row) for row in np.atleast_2d(array)) + "\n"


def image(path: Path, pixels: npt.NDArray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels[..., ::-1] if pixels.ndim == 3 else pixels)


def write_frames(
    root: Path,
    *,
    count: int = FRAMES,
    units: float = 1000,
    K: Array | None = None,
    stored: Callable[[int, Array], Array] = lambda i, T: T,
) -> Path:
    """The `frames` layout; `stored` makes of the true pose what the file says."""
    (root / "pose").mkdir(parents=True)
    (root / "intrinsics.txt").write_text(text(CAMERA.matrix if K is None else K))
    for i in range(count):
        color, depth = render(pose(i))
        image(root / f"color/{i:05d}.png", color)
        image(root / f"depth/{i:05d}.png", np.rint(depth * units).astype(np.uint16))
        (root / f"pose/{i:05d}.txt").write_text(text(stored(i, pose(i))))
    return root


def write_tum(root: Path, *, order: str = "xyzw", count: int = FRAMES) -> Path:
    """TUM's lists, the depth images 3 ms and the poses 5 ms after the colour images."""
    root.mkdir(parents=True)
    lists: dict[str, list[str]] = {"rgb": ["# color images"], "depth": ["# depth"], "groundtruth": ["# ground truth"]}
    for i in range(count):
        color, depth = render(pose(i))
        image(root / f"rgb/{i}.png", color)
        image(root / f"depth/{i}.png", np.rint(depth * 5000).astype(np.uint16))
        q = quaternion(pose(i))
        q = q if order == "xyzw" else q[[3, 0, 1, 2]]
        lists["rgb"].append(f"{i / 30:.6f} rgb/{i}.png")
        lists["depth"].append(f"{i / 30 + 0.003:.6f} depth/{i}.png")
        values = " ".join(f"{value:.9g}" for value in (*pose(i)[:3, 3], *q))
        lists["groundtruth"].append(f"{i / 30 + 0.005:.6f} {values}")
    for name, lines in lists.items():
        (root / f"{name}.txt").write_text("\n".join(lines) + "\n")
    (root / "intrinsics.txt").write_text(text(CAMERA.matrix))
    return root
