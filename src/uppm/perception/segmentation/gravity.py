"""Which way is up in the map, and at what heights floor and ceiling are: estimated once from a few frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.types import Frame
from uppm.perception.segmentation.surfaces import surfaces

Vectors = npt.NDArray[np.float64]

MAX_TILT_COS = float(np.cos(np.radians(50)))
"""The up axis is sought within this angle of the cameras' mean upward direction."""
PARALLEL_COS = float(np.cos(np.radians(8)))
CANDIDATES = 200
SAMPLES_A_FRAME = 2000
HEIGHT_BIN = 0.03
MIN_PEAK = 0.2
"""A floor or ceiling has at least this share of the largest horizontal surface's area."""
MIN_CAMERA_HEIGHT = 0.6
"""The floor is at least so far below the cameras, metres; a table top that fills the view is not."""
MIN_CEILING = 1.9
"""Metres above the floor."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Gravity:
    """Up axis and structural heights of a map."""

    up: Vectors
    """(3,), unit, frame map."""
    floor: float | None
    """Height of the floor along `up`, metres; None where none was seen."""
    ceiling: float | None


def estimate_gravity(frames: Sequence[Frame], axis: str = "auto") -> Gravity:
    """Gravity from the dominant horizontal surfaces of some frames; `axis` such as "+z" fixes the up axis."""
    samples = [_sample(frame) for frame in frames]
    points, normals, areas = (np.concatenate(part) for part in zip(*samples, strict=True))
    cameras = np.stack([frame.T_map_camera for frame in frames])
    up = _named_axis(axis) if axis != "auto" else _up(normals, areas, _unit(-cameras[:, :3, 1].mean(axis=0)))
    heights, tilt = points @ up, normals @ up
    camera = float(np.median(cameras[:, :3, 3] @ up))
    floor = _lowest_peak(heights[tilt > PARALLEL_COS], areas[tilt > PARALLEL_COS], camera - MIN_CAMERA_HEIGHT)
    down = tilt < -PARALLEL_COS
    top = _lowest_peak(-heights[down], areas[down], -camera)
    ceiling = -top if top is not None and (floor is None or -top - floor > MIN_CEILING) else None
    return Gravity(up=up, floor=floor, ceiling=ceiling)


def _sample(frame: Frame) -> tuple[Vectors, Vectors, Vectors]:
    """Points, normals (frame map) and surface areas of an even choice of a frame's pixels."""
    surface = surfaces(frame)
    rows, columns = np.nonzero((surface.patches > 0) & (surface.depth > 0))
    every = max(1, len(rows) // SAMPLES_A_FRAME)
    at = (rows[::every], columns[::every])
    p, n = surface.points[at].astype(np.float64), surface.normals[at].astype(np.float64)
    facing = np.abs(np.einsum("ij,ij->i", p, n)) / np.maximum(np.linalg.norm(p, axis=1), 1e-6)
    areas = p[:, 2] ** 2 / np.maximum(facing, 0.1)
    R, t = frame.T_map_camera[:3, :3], frame.T_map_camera[:3, 3]
    return p @ R.T + t, n @ R.T, areas


def _named_axis(name: str) -> Vectors:
    up = np.zeros(3)
    up["xyz".index(name[1])] = -1.0 if name[0] == "-" else 1.0
    return up


def _unit(vector: Vectors) -> Vectors:
    length = np.linalg.norm(vector)
    return vector / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])


def _up(normals: Vectors, areas: Vectors, prior: Vectors) -> Vectors:
    """The direction near the prior that most surface is parallel or at right angles to."""
    near = np.flatnonzero(normals @ prior > MAX_TILT_COS)
    if not len(near):
        return prior
    candidates = normals[near[:: max(1, len(near) // CANDIDATES)]]
    cosines = candidates @ normals.T
    support = (cosines > PARALLEL_COS) @ areas + 0.5 * ((np.abs(cosines) < np.sqrt(1 - PARALLEL_COS**2)) @ areas)
    up = candidates[int(support.argmax())]
    for _ in range(3):
        agree = normals @ up > PARALLEL_COS
        up = _unit((normals[agree] * areas[agree, None]).sum(axis=0))
    return up


def _lowest_peak(heights: Vectors, areas: Vectors, limit: float) -> float | None:
    """Height of the lowest large horizontal surface below `limit`."""
    below = heights < limit
    if not below.any():
        return None
    heights, areas = heights[below], areas[below]
    bins = np.floor((heights - heights.min()) / HEIGHT_BIN).astype(int)
    histogram = np.convolve(np.bincount(bins, areas), np.ones(3), mode="same")
    low = int(np.argmax(histogram >= MIN_PEAK * histogram.max()))
    peak = low + int(histogram[low : low + 4].argmax())
    around = np.abs(bins - peak) <= 1
    return float(np.average(heights[around], weights=areas[around]))
