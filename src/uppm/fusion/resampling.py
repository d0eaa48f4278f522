"""Voxels of one submap on another grid: for a new voxel size, and for merging two submaps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from uppm.core.geometry import invert, transform
from uppm.core.types import VOXELS_PER_SIDE, VoxelBlocks

FULL = 32767.0
IDENTITY = np.eye(4)


def empty_blocks() -> VoxelBlocks:
    """No blocks."""
    return _blocks(np.empty((0, 3), dtype=np.int32))


def _blocks(coords: npt.NDArray[np.int32]) -> VoxelBlocks:
    n, s = len(coords), VOXELS_PER_SIDE
    return VoxelBlocks(
        coords=coords,
        distance=np.zeros((n, s, s, s), dtype=np.int16),
        weight=np.zeros((n, s, s, s), dtype=np.float32),
        color=np.zeros((n, s, s, s, 3), dtype=np.uint8),
        belonging=np.zeros((n, s, s, s, 2), dtype=np.uint8),
    )


class _Dense:
    """All voxels of a submap in one array, with a border of one block of unobserved voxels."""

    def __init__(self, blocks: VoxelBlocks) -> None:
        s = VOXELS_PER_SIDE
        self.low = blocks.coords.min(axis=0) - 1
        shape = (blocks.coords.max(axis=0) + 2 - self.low) * s
        self.distance = np.zeros(shape, dtype=np.float32)
        self.weight = np.zeros(shape, dtype=np.float32)
        self.rest = np.zeros((*shape, 5), dtype=np.uint8)
        for n, (x, y, z) in enumerate((blocks.coords - self.low) * s):
            at = np.s_[x : x + s, y : y + s, z : z + s]
            self.distance[at], self.weight[at] = blocks.distance[n], blocks.weight[n]
            self.rest[at] = np.concatenate([blocks.color[n], blocks.belonging[n]], axis=-1)


def resample(
    blocks: VoxelBlocks,
    voxel_size: float,
    truncation: float,
    new_voxel_size: float,
    new_truncation: float,
    T_old_new: npt.NDArray[np.float64] = IDENTITY,
) -> VoxelBlocks:
    """The same surface on another grid: distance trilinear over observed voxels, the rest from the nearest.

    Sizes in metres; T_old_new (4, 4): the new submap frame in the old. A voxel is observed where at least half of its
    interpolation weight is. Distances keep their metres; what the old truncation cut off stays at the old truncation.
    """
    if not len(blocks):
        return blocks
    dense, s = _Dense(blocks), VOXELS_PER_SIDE
    out = _blocks(_blocks_over(blocks.coords, voxel_size, new_voxel_size, T_old_new))
    inside = (np.stack(np.meshgrid(*[np.arange(s)] * 3, indexing="ij"), axis=-1) + 0.5).reshape(-1, 3)
    observed = (dense.weight > 0).astype(np.float32)
    scaled = dense.distance * observed * np.float32(truncation / new_truncation)
    for n, corner in enumerate(out.coords):
        old = transform(T_old_new, (corner * s + inside) * new_voxel_size)
        at = (old / voxel_size - 0.5 - dense.low * s).T
        share = map_coordinates(observed, at, order=1, mode="constant")
        distance = map_coordinates(scaled, at, order=1, mode="constant") / np.maximum(share, 1e-6)
        nearest = np.rint(at).astype(np.intp)
        hit = ((nearest >= 0) & (nearest < np.array(dense.weight.shape)[:, None])).all(axis=0) & (share >= 0.5)
        pick = tuple(np.where(hit, nearest, 0))
        out.distance[n] = np.clip(np.where(hit, distance, 0), -FULL, FULL).reshape(s, s, s)
        out.weight[n] = np.where(hit, map_coordinates(dense.weight, at, order=1, mode="constant"), 0).reshape(s, s, s)
        rest = np.where(hit[:, None], dense.rest[pick], 0).reshape(s, s, s, 5)
        out.color[n], out.belonging[n] = rest[..., :3], rest[..., 3:]
    return keep(out, np.asarray((out.weight > 0).any(axis=(1, 2, 3))))


def _blocks_over(
    coords: npt.NDArray[np.int32], voxel_size: float, new_voxel_size: float, T_old_new: npt.NDArray[np.float64]
) -> npt.NDArray[np.int32]:
    """Coordinates (M, 3), sorted, of the new grid's blocks that the old blocks (N, 3) reach into."""
    side, new_side = VOXELS_PER_SIDE * voxel_size, VOXELS_PER_SIDE * new_voxel_size
    corners = (coords[:, None] + np.array(list(np.ndindex(2, 2, 2)))) * side
    # Rounded, so that a block that ends where the next begins does not reach into it.
    reach = np.round(transform(invert(T_old_new), corners) / new_side, 6)
    low, high = np.floor(reach.min(axis=1)).astype(int), np.ceil(reach.max(axis=1)).astype(int)
    covered = [
        np.stack(np.meshgrid(*map(np.arange, a, b), indexing="ij"), -1).reshape(-1, 3)
        for a, b in zip(low, high, strict=True)
    ]
    return np.unique(np.concatenate(covered), axis=0).astype(np.int32)


def keep(blocks: VoxelBlocks, which: npt.NDArray[np.bool_]) -> VoxelBlocks:
    """The blocks where `which` (N,) holds."""
    return VoxelBlocks(
        coords=blocks.coords[which],
        distance=blocks.distance[which],
        weight=blocks.weight[which],
        color=blocks.color[which],
        belonging=blocks.belonging[which],
    )


def combine(kept: VoxelBlocks, other: VoxelBlocks) -> VoxelBlocks:
    """Two submaps of one object on the same grid as one: means by weight, counters added.

    What either saw as foreign may have been the other, so the lesser of the two counts stays.
    """
    coords = np.unique(np.concatenate([kept.coords, other.coords]), axis=0)
    a, b = _spread(kept, coords), _spread(other, coords)
    total = a.weight + b.weight
    share = np.divide(b.weight, total, out=np.zeros_like(total), where=total > 0)
    distance = a.distance + (b.distance.astype(np.float32) - a.distance) * share
    color = a.color + (b.color.astype(np.float32) - a.color) * share[..., None]
    belongs = a.belonging[..., 0].astype(np.int32) + b.belonging[..., 0]
    both = (a.weight > 0) & (b.weight > 0)
    foreign_a, foreign_b = a.belonging[..., 1].astype(np.int32), b.belonging[..., 1].astype(np.int32)
    foreign = np.where(both, np.minimum(foreign_a, foreign_b), foreign_a + foreign_b)
    return VoxelBlocks(
        coords=coords,
        distance=np.rint(distance).astype(np.int16),
        weight=total,
        color=np.rint(color).astype(np.uint8),
        belonging=np.minimum(np.stack([belongs, foreign], axis=-1), 255).astype(np.uint8),
    )


def _spread(blocks: VoxelBlocks, coords: npt.NDArray[np.int32]) -> VoxelBlocks:
    """The blocks at the given coordinates (sorted, a superset), unobserved where there were none."""
    out = _blocks(coords)
    index = {tuple(c): n for n, c in enumerate(coords.tolist())}
    at = np.array([index[tuple(c)] for c in blocks.coords.tolist()], dtype=np.intp)
    out.distance[at], out.weight[at] = blocks.distance, blocks.weight
    out.color[at], out.belonging[at] = blocks.color, blocks.belonging
    return out
