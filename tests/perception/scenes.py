"""Ray-cast scenes of known geometry: a room with a floor, a back wall, and boxes on the floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uppm.core.geometry import rays
from uppm.core.types import Frame, GroundTruth, Intrinsics

FLOOR, WALL, FIRST_BOX = 1, 2, 3
Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Lowest and highest corner in the room: x right, y away from the camera, z up; the floor is z = 0."""


def camera_at(height: float = 1.2, pitch: float = 20.0) -> np.ndarray:
    """T_map_camera looking along +y, tilted down by `pitch` degrees."""
    c, s = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
    T_map_camera = np.eye(4)
    T_map_camera[:3, :3] = np.column_stack([(1, 0, 0), (0, -s, -c), (0, c, -s)])
    T_map_camera[2, 3] = height
    return T_map_camera


def room(boxes: Sequence[Box] = (), wall: float = 4.0, noise: float = 0.0, pitch: float = 20.0) -> Frame:
    """A 320x240 frame of the room with its instance image; `noise` is the deviation of the inverse depth, 1/m."""
    k = Intrinsics(fx=280.0, fy=280.0, cx=159.5, cy=119.5, width=320, height=240)
    T = camera_at(pitch=pitch)
    direction, origin = rays(k).astype(np.float64) @ T[:3, :3].T, T[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(direction[..., 2] < 0, -origin[2] / direction[..., 2], np.inf)
        back = np.where(direction[..., 1] > 0, (wall - origin[1]) / direction[..., 1], np.inf)
        hits = np.stack([floor, back, *(_box_hit(origin, direction, box) for box in boxes)])
    depth = hits.min(axis=0)
    instance = hits.argmin(axis=0).astype(np.int32) + 1
    if noise:
        depth = 1 / (1 / depth + np.random.default_rng(0).normal(0, noise, depth.shape))
    colors = np.random.default_rng(1).integers(40, 255, (len(hits) + 1, 3)).astype(np.uint8)
    names = {FLOOR: "floor", WALL: "wall"} | {FIRST_BOX + i: f"box {i}" for i in range(len(boxes))}
    truth = GroundTruth(instance=instance, names=names, things=frozenset(range(FIRST_BOX, FIRST_BOX + len(boxes))))
    return Frame(
        index=0, stamp=0.0, color=colors[instance], depth=depth.astype(np.float32), T_map_camera=T,
        intrinsics=k, truth=truth,
    )  # fmt: skip


def _box_hit(origin: np.ndarray, direction: np.ndarray, box: Box) -> np.ndarray:
    """Distance along each ray to the box, slab by slab; infinite where it misses."""
    first, second = ((np.asarray(corner) - origin) / direction for corner in box)
    enter, leave = np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)
    return np.where((enter < leave) & (enter > 0), enter, np.inf)


def box_around(mask: np.ndarray) -> np.ndarray:
    """(4,) tight box of a mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float32)


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)
