"""A submap that is observed as two objects for long becomes two (method.md section 4).

Two segments that fall on one submap in one frame say little: masks fall apart. They count only where they divide it as
earlier frames did, which is known from the cells of space that each side was seen in.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from uppm.core.geometry import invert, transform
from uppm.core.types import VOXELS_PER_SIDE, VoxelBlocks
from uppm.fusion.resampling import keep
from uppm.fusion.submaps import LiveSubmap
from uppm.fusion.tracking import MIN_JOIN_PIXELS
from uppm.fusion.view import View

Cells = npt.NDArray[np.int32]

CELL = 2
"""Voxels along a cell's side."""
LIMIT = 1 << 20
"""Cells lie within so many of a submap's origin: 40 km."""
SAMPLES = 160
"""Columns of the image that are looked at."""
ONE_SIDED = 0.5
"""Mean side of a segment's cells, from -1 to 1, at which it lies on one side: three quarters of them do."""
BOTH = 0.2
"""Share of a segment's cells on the lesser side at which it covers both."""
ON_SUBMAP = 0.3
"""Share of a segment's pixels that lie on the submap's surface, for it to be a part of it: not all of it was seen."""


def rivals(
    row: int, targets: npt.NDArray[np.intp], overlap: npt.NDArray[np.int64], observed: npt.NDArray[np.int64]
) -> list[int]:
    """Segments on a submap's surface: the largest that goes to it, then the largest of the others; none without it.

    Arguments as for `tracking.join_contained`; row: of the submap in `overlap`.
    """
    on = overlap[row, 1:]
    parts = np.flatnonzero((on >= MIN_JOIN_PIXELS) & (on >= ON_SUBMAP * observed))
    parts = parts[np.argsort(-on[parts], kind="stable")]
    mine = parts[targets[parts] == row]
    return [*mine[:1].tolist(), *parts[parts != mine[0]][:1].tolist()] if len(mine) else []


def segment_cells(
    submap: LiveSubmap, view: View, ids: npt.NDArray[np.int32], T_map_camera: npt.NDArray[np.float64], segment: int
) -> Cells:
    """Cells (N, 3), sorted, of a submap's frame in which a segment was measured; segment: its id in `ids`."""
    step = max(1, view.shape[1] // SAMPLES)
    depth = view.depth[::step, ::step]
    v, u = np.nonzero((ids[::step, ::step] == segment) & (depth > 0))
    z = depth[v, u].astype(np.float64)
    points = np.stack([view.ray_x[::step][u] * z, view.ray_y[::step][v] * z, z], axis=1)
    local = transform(invert(submap.T_map_submap) @ T_map_camera, points)
    cells = np.floor(local / (CELL * submap.voxel_size)).astype(np.int64)
    return _cells(np.unique(_keys(cells)))


def _keys(cells: npt.NDArray[np.integer]) -> npt.NDArray[np.int64]:
    """One number a cell (N, 3), in their order: `numpy.unique` of rows is ten times slower."""
    x, y, z = (cells.astype(np.int64) + LIMIT).T
    return (x * 2 * LIMIT + y) * 2 * LIMIT + z


def _cells(keys: npt.NDArray[np.int64]) -> Cells:
    """Inverse of `_keys`."""
    rest, z = np.divmod(keys, 2 * LIMIT)
    return (np.stack([*np.divmod(rest, 2 * LIMIT), z], axis=1) - LIMIT).astype(np.int32)


def seen_apart(submap: LiveSubmap, one: Cells, other: Cells) -> None:
    """Two segments fell on the submap: evidence for two objects where they divide it as before, else against."""
    if not len(one) or not len(other):
        return
    sides = 1.0, -1.0
    if submap.apart:
        sides = _mean_side(submap.parts, one), _mean_side(submap.parts, other)
        if max(sides) < ONE_SIDED or min(sides) > -ONE_SIDED:
            _doubt(submap)
            return
    first, second = (one, other) if sides[0] > sides[1] else (other, one)
    submap.apart += 1
    submap.parts = _counted(submap.parts, first, second)


def seen_as_one(submap: LiveSubmap, cells: Cells) -> None:
    """One segment fell on the submap: evidence against two objects where it covers both parts."""
    if not submap.apart or not len(cells):
        return
    side = _sides(submap.parts, cells + 0.5)
    if min(np.mean(side > 0), np.mean(side < 0)) >= BOTH:
        _doubt(submap)


def _doubt(submap: LiveSubmap) -> None:
    submap.apart -= 1
    if not submap.apart:
        submap.forget_parts()


def _counted(parts: Cells, first: Cells, second: Cells) -> Cells:
    votes = [np.column_stack([cells, np.full(len(cells), vote)]) for cells, vote in ((first, 1), (second, -1))]
    rows = np.concatenate([parts, *votes])
    keys, cell = np.unique(_keys(rows[:, :3]), return_inverse=True)
    counts = np.bincount(cell, weights=rows[:, 3], minlength=len(keys))
    return np.column_stack([_cells(keys), counts]).astype(np.int32)


def _sides(parts: Cells, cells: npt.NDArray[np.floating]) -> npt.NDArray[np.int32]:
    """1 or -1 (N,) at coordinates (N, 3) in cells: the side of the nearest cell that has one."""
    decided = parts[parts[:, 3] != 0]
    if not len(decided):
        return np.zeros(len(cells), dtype=np.int32)
    return np.sign(decided[KDTree(decided[:, :3] + 0.5).query(cells)[1], 3])


def _mean_side(parts: Cells, cells: Cells) -> float:
    return float(_sides(parts, cells + 0.5).mean())


def side_of(submap: LiveSubmap, cells: Cells) -> int:
    """1 or -1: the part that most of the cells lie on."""
    return 1 if _mean_side(submap.parts, cells) > 0 else -1


def divide(submap: LiveSubmap, blocks: VoxelBlocks, leaving: int | None) -> tuple[VoxelBlocks, VoxelBlocks]:
    """The voxels of the part that stays and of the one that leaves: side 1 or -1; None: the lesser.

    Both keep distance, weight and colour around their part, so that neither ends in a gap; a voxel belongs to one.
    """
    inside = np.moveaxis(np.indices((VOXELS_PER_SIDE,) * 3), 0, -1) + 0.5
    voxel = VOXELS_PER_SIDE * blocks.coords[:, None, None, None] + inside
    side = _sides(submap.parts, voxel.reshape(-1, 3) / CELL).reshape(blocks.weight.shape)
    owned = (blocks.weight > 0) & (blocks.belonging[..., 0] >= np.maximum(blocks.belonging[..., 1], 1))
    if leaving is None:
        leaving = -1 if (side[owned] > 0).sum() >= (side[owned] < 0).sum() else 1
    return _part(blocks, side != leaving, owned), _part(blocks, side == leaving, owned)


def _part(blocks: VoxelBlocks, mine: npt.NDArray[np.bool_], owned: npt.NDArray[np.bool_]) -> VoxelBlocks:
    total = np.minimum(blocks.belonging.sum(axis=-1, dtype=np.int32), 255).astype(np.uint8)
    foreign = np.stack([np.zeros_like(total), total], axis=-1)
    holds: npt.NDArray[np.bool_] = np.any(owned & mine, axis=(1, 2, 3))
    # The cells of a mesh at the rim of a block need voxels of the next.
    if holds.any():
        holds = KDTree(blocks.coords[holds]).query(blocks.coords, p=np.inf)[0] <= 1
    return keep(replace(blocks, belonging=np.where(mine[..., None], blocks.belonging, foreign)), holds)
