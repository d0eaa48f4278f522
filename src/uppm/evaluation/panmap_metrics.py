"""The two errors by which Panoptic Multi-TSDFs (Schmid et al. 2022) is evaluated, under their own name.

Unlike accuracy and completeness they ask the voxels: from the ground truth to the map it is the interpolated signed
distance at each point, from the map to the ground truth the nearest point of each mesh vertex.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from uppm.core.geometry import invert, transform
from uppm.core.types import VOXELS_PER_SIDE, VoxelBlocks
from uppm.evaluation.geometry import PointIndex

MAX_DISTANCE = 0.2
"""Metres; larger errors count as this, as in their evaluation's default."""
INLIER_DISTANCE = 0.1
"""Metres, likewise."""
_DISTANCE_ONE = 32767
"""Stored distance of one truncation distance."""
_KEY_BITS = 21

Points = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class TsdfLayer:
    """The voxels of one submap, and where they are."""

    blocks: VoxelBlocks
    voxel_size: float
    """Metres."""
    truncation: float
    """Metres."""
    T_map_submap: npt.NDArray[np.float64]
    """(4, 4)."""


@dataclass(frozen=True, kw_only=True)
class PanmapMetrics:
    """Lengths in cm, shares from 0 to 1; None where no point is known to the map."""

    panmap_gt_error_cm: float | None
    """Mean absolute signed distance at the points of G that voxels of the map surround."""
    panmap_gt_rmse_cm: float | None
    panmap_gt_unknown_ratio: float
    """Share of G that no submap's voxels surround; left out of the two above."""
    panmap_gt_inlier_ratio: float
    """Share of G within 10 cm."""
    panmap_map_error_cm: float | None
    """Mean distance of the mesh's vertices to G."""
    panmap_map_rmse_cm: float | None


def panmap_metrics(layers: Iterable[TsdfLayer], vertices: npt.NDArray[np.floating], truth: PointIndex) -> PanmapMetrics:
    """Both errors between a map's layers and mesh vertices (V, 3) and G (M, 3), frame map."""
    points = truth.points
    distance = np.full(len(points), np.inf)
    for layer in layers:
        # As they do for submaps that hold their own geometry only: the least signed distance of those that know it.
        distance = np.fmin(distance, interpolated_distance(layer, points))
    known = np.isfinite(distance)
    error = np.minimum(np.abs(distance[known]), MAX_DISTANCE)
    to_truth = truth.nearest(vertices.astype(np.float64))[0] if len(vertices) else np.empty(0)
    return PanmapMetrics(
        panmap_gt_error_cm=_cm(error.mean()) if len(error) else None,
        panmap_gt_rmse_cm=_cm(np.sqrt((error**2).mean())) if len(error) else None,
        panmap_gt_unknown_ratio=1 - len(error) / len(points),
        panmap_gt_inlier_ratio=float((error <= INLIER_DISTANCE).sum() / len(points)),
        panmap_map_error_cm=_cm(to_truth.mean()) if len(vertices) else None,
        panmap_map_rmse_cm=_cm(np.sqrt((to_truth**2).mean())) if len(vertices) else None,
    )


def interpolated_distance(layer: TsdfLayer, points: Points) -> npt.NDArray[np.float64]:
    """Signed distance (N,), metres, at points (N, 3), frame map, trilinear.

    NaN where one of the eight voxels around was never observed, or the point's own does not belong to the submap.
    """
    out = np.full(len(points), np.nan)
    if not len(layer.blocks):
        return out
    # Voxel centres lie half a voxel inside.
    local = transform(invert(layer.T_map_submap), points) / layer.voxel_size
    low = (layer.blocks.coords.min(axis=0)) * VOXELS_PER_SIDE
    high = (layer.blocks.coords.max(axis=0) + 1) * VOXELS_PER_SIDE
    inside = np.flatnonzero(((local >= low) & (local <= high)).all(axis=1))
    block, voxel = _voxels(layer.blocks, np.floor(local[inside]).astype(np.int64))
    belongs = layer.blocks.belonging[(block, *voxel)]
    mine = (block >= 0) & (belongs[..., 0] >= belongs[..., 1])
    inside = inside[mine]
    out[inside] = _trilinear(layer.blocks, local[inside] - 0.5) * layer.truncation
    return out


def _trilinear(blocks: VoxelBlocks, position: Points) -> npt.NDArray[np.float64]:
    """In truncation distances, at positions (N, 3) in voxels, centres whole; NaN beside what was not observed."""
    base = np.floor(position).astype(np.int64)
    share = position - base
    total = np.zeros(len(position))
    for corner in product((0, 1), repeat=3):
        block, voxel = _voxels(blocks, base + corner)
        observed = (block >= 0) & (blocks.weight[(block, *voxel)] > 0)
        value = np.where(observed, blocks.distance[(block, *voxel)] / _DISTANCE_ONE, np.nan)
        total += value * np.where(corner, share, 1 - share).prod(axis=1)
    return total


def _voxels(
    blocks: VoxelBlocks, index: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.intp], tuple[npt.NDArray[np.int64], ...]]:
    """Row of the block of each voxel (N, 3), -1 where there is none, and the voxel's place in it."""
    keys = _key(blocks.coords.astype(np.int64))
    order = np.argsort(keys)
    wanted = _key(index // VOXELS_PER_SIDE)
    row = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
    return np.where(keys[row] == wanted, row, -1), tuple((index % VOXELS_PER_SIDE).T)


def _key(coords: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    x, y, z = (coords + (1 << (_KEY_BITS - 1))).T
    return (x << (2 * _KEY_BITS)) | (y << _KEY_BITS) | z


def _cm(metres: float) -> float:
    return 100 * float(metres)
