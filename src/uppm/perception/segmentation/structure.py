"""Floor, ceiling, walls and table tops from gravity-aligned surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.types import Frame, Label, Provenance, Segment
from uppm.perception.segmentation.gravity import Gravity
from uppm.perception.segmentation.surfaces import Surfaces, surfaces

Mask = npt.NDArray[np.bool_]

LEVEL_COS = float(np.cos(np.radians(15)))
UPRIGHT_SIN = float(np.sin(np.radians(12)))
SAME_PLANE_COS = float(np.cos(np.radians(10)))
TOLERANCE = 0.04
"""Distance of a pixel from its plane, metres, before sensor noise."""
MAX_TOLERANCE = 0.15
MIN_WALL_AREA = 0.5
"""Square metres."""
MIN_WALL_TOP = 1.5
"""A wall is seen at least this high above the floor, metres, unless the image's upper border cuts it."""
FURNITURE_GAP = (0.15, 1.0)
"""An upright face with a parallel one behind it by so much is a piece of furniture, metres."""
TABLE_HEIGHT = (0.5, 1.1)
"""Metres above the floor."""
MIN_TABLE_AREA = 0.12
"""Square metres."""
SCORES = {"floor": 0.9, "ceiling": 0.9, "wall": 0.7, "table": 0.35}


@dataclass(frozen=True, kw_only=True, eq=False)
class PatchStatistics:
    """Per patch, index 0 being patch 1; heights and normals along gravity."""

    normal: npt.NDArray[np.float64]
    """(N, 3), unit, frame map."""
    center: npt.NDArray[np.float64]
    """(N, 3), frame map."""
    area: npt.NDArray[np.float64]
    """(N,), square metres."""
    top: npt.NDArray[np.float64]
    """(N,), highest point above the floor, metres."""
    flat: npt.NDArray[np.float64]
    """(N,), length of the mean normal: 1 for a plane."""


def find_structure(frame: Frame, gravity: Gravity) -> list[tuple[Mask, Segment]]:
    """Structural segments of a frame, each with its mask (H, W)."""
    surface = surfaces(frame)
    tolerance = np.clip(TOLERANCE + 3 * surface.noise * surface.depth**2, 0, MAX_TOLERANCE)
    statistics = patch_statistics(frame, gravity, surface)
    found = _levels(frame, gravity, surface, statistics, tolerance)
    found += [("wall", mask) for mask in _walls(frame, gravity, surface, statistics, tolerance)]
    found += [("table", surface.patches == patch) for patch in _tables(gravity, statistics)]
    return [(_full_size(mask, frame), _segment(name)) for name, mask in found if mask.any()]


def _levels(
    frame: Frame, gravity: Gravity, surface: Surfaces, s: PatchStatistics, tolerance: npt.NDArray[np.float32]
) -> list[tuple[str, Mask]]:
    """Floor and ceiling: level pixels at their height, and the whole of the patches that are level and there."""
    R, t = frame.T_map_camera[:3, :3], frame.T_map_camera[:3, 3]
    up = (R.T @ gravity.up).astype(np.float32)
    height = surface.points @ up + np.float32(t @ gravity.up)
    level = surface.normals @ up
    found: list[tuple[str, Mask]] = []
    for name, at, sign in (("floor", gravity.floor, 1), ("ceiling", gravity.ceiling, -1)):
        if at is None:
            continue
        near = (surface.depth > 0) & (np.abs(height - at) < tolerance)
        flat = (sign * (s.normal @ gravity.up) > LEVEL_COS) & (s.flat > 0.9)
        whole = _of_patches(surface, flat & (np.abs(s.center @ gravity.up - at) < 2 * TOLERANCE))
        found.append((name, near & ((sign * level > LEVEL_COS) | whole)))
    return found


def _of_patches(surface: Surfaces, chosen: Mask) -> Mask:
    """Pixels (h, w) of the patches whose flag in `chosen` (N,) is set."""
    return np.concatenate([[False], chosen])[surface.patches]


def _segment(name: str) -> Segment:
    label = Label(text=name, provenance=Provenance.STRUCTURE)
    return Segment(label=label, score=SCORES[name], is_thing=name == "table")


def _full_size(mask: Mask, frame: Frame) -> Mask:
    size = (frame.intrinsics.width, frame.intrinsics.height)
    full = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return full.astype(bool) & (frame.depth > 0)


def patch_statistics(frame: Frame, gravity: Gravity, surface: Surfaces) -> PatchStatistics:
    """Mean normal, centre, area and top of each patch, from every second pixel of every second row."""
    patches, n = surface.patches[::2, ::2], surface.count
    seen = (patches > 0) & (surface.depth[::2, ::2] > 0)
    ids = patches[seen] - 1
    p, normals = surface.points[::2, ::2][seen].astype(np.float64), surface.normals[::2, ::2][seen].astype(np.float64)
    counts = np.maximum(np.bincount(ids, minlength=n), 1)[:, None]
    center = np.stack([np.bincount(ids, p[:, k], n) for k in range(3)], axis=1) / counts
    normal = np.stack([np.bincount(ids, normals[:, k], n) for k in range(3)], axis=1) / counts
    flat = np.linalg.norm(normal, axis=1)
    facing = np.abs(np.einsum("ij,ij->i", p, normals)) / np.linalg.norm(p, axis=1)
    k = frame.intrinsics
    area = (2 * surface.scale) ** 2 / (k.fx * k.fy) * p[:, 2] ** 2 / np.maximum(facing, 0.1)
    R, t = frame.T_map_camera[:3, :3], frame.T_map_camera[:3, 3]
    top = np.full(n, -np.inf)
    np.maximum.at(top, ids, p @ (R.T @ gravity.up) + t @ gravity.up - (gravity.floor or 0.0))
    unit = normal / np.maximum(flat, 1e-9)[:, None]
    return PatchStatistics(
        normal=unit @ R.T,
        center=center @ R.T + t,
        area=np.bincount(ids, area.astype(np.float64), n).astype(np.float64),
        top=top,
        flat=flat,
    )


def _walls(
    frame: Frame, gravity: Gravity, surface: Surfaces, s: PatchStatistics, tolerance: npt.NDArray[np.float32]
) -> list[Mask]:
    """One mask a wall: upright patches that share a plane, large and high enough, with nothing parallel behind."""
    upright = (np.abs(s.normal @ gravity.up) < UPRIGHT_SIN) & (s.flat > 0.9)
    left, walls = upright.copy(), []
    R, t = frame.T_map_camera[:3, :3], frame.T_map_camera[:3, 3]
    for seed in np.argsort(-s.area, kind="stable"):
        if not left[seed] or s.area[seed] < MIN_WALL_AREA / 2:
            continue
        normal = s.normal[seed]
        offset = (s.center - s.center[seed]) @ normal
        parallel = upright & (s.normal @ normal > SAME_PLANE_COS)
        members = parallel & left & (np.abs(offset) < 2 * TOLERANCE)
        left &= ~members
        behind = parallel & (offset < -FURNITURE_GAP[0]) & (offset > -FURNITURE_GAP[1])
        furniture = s.area[behind].sum() > 0.25 * s.area[members].sum()
        own = _of_patches(surface, members)
        cut = own[:3].any()
        low = gravity.floor is not None and not cut and s.top[members].max() < MIN_WALL_TOP
        if furniture or low or s.area[members].sum() < MIN_WALL_AREA:
            continue
        distance = np.abs(surface.points @ (R.T @ normal) + (t - s.center[seed]) @ normal)
        near = (distance < tolerance) & (surface.depth > 0) & (surface.normals @ (R.T @ normal) > LEVEL_COS)
        walls.append(near | own)
    return walls


def _tables(gravity: Gravity, s: PatchStatistics) -> list[int]:
    """Patch ids of level surfaces at a table's height."""
    if gravity.floor is None:
        return []
    above = s.center @ gravity.up - gravity.floor
    fits = (above > TABLE_HEIGHT[0]) & (above < TABLE_HEIGHT[1]) & (s.area > MIN_TABLE_AREA)
    level = (s.normal @ gravity.up > LEVEL_COS) & (s.flat > 0.98)
    return [int(i) + 1 for i in np.flatnonzero(fits & level)]
