"""What of the space is occupied, free or unknown, on one regular grid: the map as a robot that moves needs it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt, label, map_coordinates

from uppm.core.categories import category_by_id
from uppm.core.errors import InputError
from uppm.core.geometry import invert, transform, upright
from uppm.core.types import VOXELS_PER_SIDE, Mesh, Submap, SubmapKind, SubmapState, VoxelBlocks
from uppm.map.panoptic_map import PanopticMap

UNKNOWN, FREE, OCCUPIED = -1, 0, 1
MAX_CELLS = 400_000_000
MIN_POCKET = 0.1
"""Cubic metres."""
FULL = 32767.0
FLOORS = "floor", "carpet", "rug"
"""Beginnings of the names of categories that one stands on."""


class NothingThereError(InputError):
    """The map has no surface, or none at the heights asked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OccupancyGrid:
    """Cells along the axes of frame grid: the map's, turned so that z is up."""

    state: npt.NDArray[np.int8]
    """(X, Y, Z): UNKNOWN, FREE or OCCUPIED."""
    category: npt.NDArray[np.int16]
    """(X, Y, Z): unified category of what occupies a cell; 0: nothing, or the unlabeled background."""
    resolution: float
    """Metres."""
    origin: npt.NDArray[np.float64]
    """(3,): lowest corner of cell (0, 0, 0), frame grid, metres."""
    T_grid_map: npt.NDArray[np.float64]
    """(4, 4), a rotation: the identity where the map's z is up."""
    floor: float
    """Height of the floor, z of frame grid, metres."""

    def layers(self, low: float, high: float) -> slice:
        """Cells along z between two heights over the floor, metres; raises `InputError` where there are none."""
        z = self.origin[2] + (np.arange(self.state.shape[2]) + 0.5) * self.resolution - self.floor
        inside = np.flatnonzero((z >= low) & (z <= high))
        if not inside.size:
            found = f"{low:g} to {high:g} m, where the map reaches from {z[0]:.2f} to {z[-1]:.2f} m"
            advice = "name a band within it, a cell high at least"
            raise NothingThereError("height band", expected="heights over the floor", found=found, advice=advice)
        return slice(int(inside[0]), int(inside[-1]) + 1)

    def plan(self, low: float, high: float) -> npt.NDArray[np.int8]:
        """(X, Y): OCCUPIED where a cell of the band is, else FREE where one is, else UNKNOWN."""
        return self.state[:, :, self.layers(low, high)].max(axis=2)


def occupancy_grid(panoptic: PanopticMap, resolution: float = 0.05) -> OccupancyGrid:
    """The whole map on one grid.

    A cell is occupied where a surface passes through it; else free where some submap, or freespace, was observed in
    front of its surface there, and no submap behind its own; else unknown.

    Parameters
    ----------
    resolution : float
        Side of a cell, metres.

    Raises
    ------
    InputError
        The map has no surface, or would need more than 400 million cells.
    """
    rotation = np.eye(4)
    rotation[:3, :3] = upright(panoptic.up)
    solid = [s for s in panoptic.submaps if s.kind is not SubmapKind.FREESPACE and s.state is not SubmapState.TENTATIVE]
    points = {s.id: transform(rotation, _dense(panoptic.submap_mesh(s.id), resolution)) for s in solid}
    seen = np.concatenate([np.empty((0, 3)), *points.values()])
    if not len(seen):
        advice = "map more frames"
        raise NothingThereError("occupancy grid", expected="a map with surfaces", found="none", advice=advice)
    origin = np.floor(seen.min(axis=0) / resolution - 1) * resolution
    shape = tuple((np.ceil((seen.max(axis=0) - origin) / resolution).astype(int) + 1).tolist())
    if np.prod(shape, dtype=float) > MAX_CELLS:
        found, advice = f"{' x '.join(map(str, shape))}", "choose larger cells"
        raise InputError("occupancy grid", expected=f"at most {MAX_CELLS} cells", found=found, advice=advice)
    grid = OccupancyGrid(
        state=np.full(shape, UNKNOWN, dtype=np.int8),
        category=np.zeros(shape, dtype=np.int16),
        resolution=resolution,
        origin=origin,
        T_grid_map=rotation,
        floor=_floor_height(solid, points, seen),
    )
    _fill(grid, panoptic, solid, points)
    return grid


def distance_field(state: npt.NDArray[np.int8], resolution: float) -> npt.NDArray[np.float32]:
    """Signed Euclidean distances (metres) between cell centres, exact: of a cell that is not occupied to the nearest
    that is, positive; of an occupied cell to the nearest that is not, negative. Infinite without any."""
    occupied = state == OCCUPIED
    if not occupied.any():
        return np.full(state.shape, np.inf, dtype=np.float32)
    return ((_distances(~occupied) - _distances(occupied)) * resolution).astype(np.float32)


def _distances(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    return np.asarray(distance_transform_edt(cells))


def _fill(
    grid: OccupancyGrid, panoptic: PanopticMap, solid: list[Submap], points: dict[int, npt.NDArray[np.float64]]
) -> None:
    inside = np.zeros(grid.state.shape, dtype=np.bool_)
    for submap in (s for s in panoptic.submaps if s.kind is SubmapKind.FREESPACE):
        _mark_freespace(grid, submap, panoptic.blocks(submap.id))
    for submap in solid:
        front, behind = _beside_surface(submap, panoptic.blocks(submap.id), grid)
        grid.state[front] = FREE
        inside[behind] = True
    grid.state[inside] = UNKNOWN
    for submap in solid:
        cells = _cells(grid, points[submap.id])
        grid.state[cells] = OCCUPIED
        if submap.descriptor:
            grid.category[cells] = submap.descriptor.category.id
    _forget_pockets(grid)


def _forget_pockets(grid: OccupancyGrid) -> None:
    """Small pockets of free cells lie inside things, where freespace's coarse voxels cannot tell: they are unknown."""
    parts, count = cast("tuple[npt.NDArray[np.int32], int]", label(grid.state == FREE))
    small = np.bincount(parts.ravel(), minlength=count + 1) * grid.resolution**3 < MIN_POCKET
    small[0] = False
    grid.state[small[parts]] = UNKNOWN


def _dense(mesh: Mesh, spacing: float) -> npt.NDArray[np.float64]:
    """Points on all triangles, at most `spacing` apart."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    if not len(corners):
        return np.empty((0, 3))
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    pieces = np.maximum(np.ceil(longest / (0.7 * spacing)).astype(int), 1)
    out = [mesh.vertices.astype(np.float64)]
    for n in np.unique(pieces):
        i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
        share = np.stack([i, j], axis=-1)[i + j < n].astype(np.float64) + 1 / 3
        weights = np.column_stack([n - share.sum(axis=1), share]) / n
        out.append(np.einsum("pc,fcx->fpx", weights, corners[pieces == n]).reshape(-1, 3))
    return np.concatenate(out)


def _floor_height(
    solid: list[Submap], points: dict[int, npt.NDArray[np.float64]], seen: npt.NDArray[np.float64]
) -> float:
    """Median height of what one stands on, or else the lowest surface but for outliers."""
    floors = [
        points[s.id]
        for s in solid
        if s.descriptor and category_by_id()[s.descriptor.category.id].name.startswith(FLOORS)
    ]
    if floors and sum(map(len, floors)):
        return float(np.median(np.concatenate(floors)[:, 2]))
    return float(np.percentile(seen[:, 2], 1))


def _cells(grid: OccupancyGrid, points: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.int64], ...]:
    """Cells of points (N, 3), frame grid; points outside are left out."""
    cells = np.floor((points - grid.origin) / grid.resolution).astype(np.int64)
    inside = ((cells >= 0) & (cells < grid.state.shape)).all(axis=1)
    return tuple(cells[inside].T)


def _voxel_centers(submap: Submap, blocks: VoxelBlocks, chosen: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Centres (N, 3) of the chosen voxels (B, 8, 8, 8), frame map."""
    block, *inner = np.nonzero(chosen)
    voxels = blocks.coords[block] * VOXELS_PER_SIDE + np.stack(inner, axis=1)
    return transform(submap.T_map_submap, (voxels + 0.5) * submap.voxel_size)


def _beside_surface(
    submap: Submap, blocks: VoxelBlocks, grid: OccupancyGrid
) -> tuple[tuple[npt.NDArray[np.int64], ...], tuple[npt.NDArray[np.int64], ...]]:
    """Cells in front of a submap's surface, and behind it, by its voxels half a voxel off and more."""
    half = 0.5 * FULL * submap.voxel_size / submap.truncation
    owned = (
        (blocks.weight > 0) & (blocks.belonging[..., 0] > 0) & (blocks.belonging[..., 0] >= blocks.belonging[..., 1])
    )
    pieces = int(np.ceil(submap.voxel_size / grid.resolution))
    steps = ((np.arange(pieces) + 0.5) / pieces - 0.5) * submap.voxel_size
    offsets = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    found = []
    for chosen in (owned & (blocks.distance > half), owned & (blocks.distance < -half)):
        centers = transform(grid.T_grid_map, _voxel_centers(submap, blocks, chosen))
        found.append(_cells(grid, (centers[:, None] + offsets).reshape(-1, 3)))
    return found[0], found[1]


def _mark_freespace(grid: OccupancyGrid, submap: Submap, blocks: VoxelBlocks) -> None:
    """Mark as free what freespace's distances, interpolated between its coarse voxels, have in front of surfaces."""
    if not len(blocks):
        return
    low = blocks.coords.min(axis=0)
    size = (blocks.coords.max(axis=0) - low + 1) * VOXELS_PER_SIDE
    field = np.full(size, -1.0, dtype=np.float32)
    for coord, distance, weight in zip(blocks.coords, blocks.distance, blocks.weight, strict=True):
        x, y, z = (coord - low) * VOXELS_PER_SIDE
        s = VOXELS_PER_SIDE
        field[x : x + s, y : y + s, z : z + s] = np.where(weight > 0, distance / FULL, -1.0)
    T_submap_grid = invert(grid.T_grid_map @ submap.T_map_submap)
    xs, ys = (grid.origin[a] + (np.arange(grid.state.shape[a]) + 0.5) * grid.resolution for a in (0, 1))
    x, y = np.meshgrid(xs, ys, indexing="ij")
    for k in range(grid.state.shape[2]):
        z = np.full_like(x, grid.origin[2] + (k + 0.5) * grid.resolution)
        local = transform(T_submap_grid, np.stack([x, y, z], axis=-1)) / submap.voxel_size
        place = np.moveaxis(local - low * VOXELS_PER_SIDE - 0.5, -1, 0)
        free = map_coordinates(field, place, order=1, mode="constant", cval=-1.0) > 0
        layer = grid.state[:, :, k]
        layer[free] = FREE
