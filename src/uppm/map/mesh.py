"""Triangles from voxel blocks: marching cubes tile by tile, welded, coloured (method.md section 4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from skimage.measure import marching_cubes

from uppm.core.geometry import transform
from uppm.core.types import VOXELS_PER_SIDE, Mesh, Submap, VoxelBlocks

_T = TypeVar("_T", bound=np.generic)
_C = TypeVar("_C", np.uint8, np.float32)

MIN_BELONGING = 2
"""Corners of a cell that must belong to the submap; 2 lets neighbouring surfaces meet without a gap."""
MAX_STEP, DEEP = 1.8, 0.8
"""Voxels of distance that an edge of a cell may span where it crosses the surface, and how deep it may end doing so."""
_TILE = 8
"""Blocks along a tile's side: bounds the memory of long thin submaps, such as walls around a corner."""
_LEVEL = -0.5
"""Isovalue in units of `VoxelBlocks.distance`: no integer equals it, so that no triangle degenerates."""
_WELD = 1e-4
"""Voxels; tiles compute the vertices of their shared face alike, up to rounding."""
_FILL_RINGS = 4
"""Vertices so far from one with a colour get theirs from their neighbours."""


@dataclass(frozen=True)
class _Tile:
    """Blocks as one dense array; `index` (bx, by, bz) is the block at each place, -1 for none."""

    low: npt.NDArray[np.int64]
    """(3,) block coordinate of index[0, 0, 0]."""
    index: npt.NDArray[np.int64]
    shape: tuple[int, ...]
    """Voxels of the tile and of the one layer that it shares with each next tile."""

    def dense(self, per_block: npt.NDArray[_T]) -> npt.NDArray[_T]:
        """(X, Y, Z) from (N + 1, 8, 8, 8) whose last block stands for absent ones."""
        bx, by, bz = self.index.shape
        s = VOXELS_PER_SIDE
        joined = per_block[self.index].transpose(0, 3, 1, 4, 2, 5).reshape(bx * s, by * s, bz * s)
        x, y, z = self.shape
        return joined[:x, :y, :z]


def submap_mesh(submap: Submap, blocks: VoxelBlocks, *, min_belonging: int = MIN_BELONGING) -> Mesh:
    """The surface that belongs to a submap, in frame map.

    A cell is meshed where its 8 corners were observed and at least `min_belonging` of them belong to the submap. Here a
    voxel belongs only if the submap's surface was ever seen at it: one that rays merely passed has both counters at 0,
    says nothing of a surface, and has no colour.
    """
    seen = blocks.belonging[..., 0] > 0
    # Colour is kept near the surface only; black stands for none, and black surroundings fill it in black.
    colored = seen & blocks.color.any(axis=-1)
    distance = _padded(blocks.distance).astype(np.float32)
    observed = _padded(blocks.weight > 0)
    belongs = _padded(seen & (blocks.weight > 0) & (blocks.belonging[..., 0] >= blocks.belonging[..., 1]))
    voxel = 32767.0 * submap.voxel_size / submap.truncation
    parts = []
    for tile in _tiles(blocks.coords):
        field = tile.dense(distance)
        cells = _cells(tile.dense(observed), tile.dense(belongs), min_belonging) & _smooth(field, voxel)
        surface = _surface(field, cells)
        if surface is not None:
            vertices, faces = surface
            colors = _colors(vertices, tile, blocks.color, colored)
            parts.append((vertices + float(VOXELS_PER_SIDE) * tile.low, colors, faces))
    if not parts:
        return empty_mesh()
    voxels, colors, faces = _joined(parts)
    if len(parts) > 1:
        voxels, colors, faces = _welded(voxels, colors, faces)
    vertices = transform(submap.T_map_submap, (voxels + 0.5) * submap.voxel_size)
    return Mesh(
        vertices=vertices.astype(np.float32),
        normals=_normals(vertices, faces),
        colors=_filled(colors, faces),
        faces=faces,
    )


def empty_mesh() -> Mesh:
    """A mesh without vertices."""
    none = np.empty((0, 3))
    return Mesh(
        vertices=none.astype(np.float32),
        normals=none.astype(np.float32),
        colors=none.astype(np.uint8),
        faces=none.astype(np.int32),
    )


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one, unwelded."""
    if not meshes:
        return empty_mesh()
    vertices, colors, faces = _joined([(m.vertices, m.colors, m.faces) for m in meshes])
    normals = np.concatenate([m.normals for m in meshes])
    return Mesh(vertices=vertices, normals=normals, colors=colors, faces=faces)


def _padded(field: npt.NDArray[_T]) -> npt.NDArray[_T]:
    return np.concatenate([field, np.zeros((1, *field.shape[1:]), field.dtype)])


def _tiles(coords: npt.NDArray[np.int32]) -> Iterator[_Tile]:
    for tile in np.unique(coords // _TILE, axis=0).astype(np.int64):
        start = tile * _TILE
        here = np.flatnonzero(((coords >= start) & (coords <= start + _TILE)).all(axis=1))
        low, high = coords[here].min(axis=0).astype(np.int64), coords[here].max(axis=0)
        index = np.full(high - low + 1, -1)
        index[tuple((coords[here] - low).T)] = here
        reach = np.minimum((high - low + 1) * VOXELS_PER_SIDE, (start + _TILE - low) * VOXELS_PER_SIDE + 1)
        yield _Tile(low, index, tuple(reach.tolist()))


def _cells(
    observed: npt.NDArray[np.bool_], belongs: npt.NDArray[np.bool_], min_belonging: int
) -> npt.NDArray[np.bool_]:
    """(X, Y, Z) True at the highest corner of each cell to mesh, where scikit-image's mask is read."""
    all_observed, belonging = observed.astype(np.bool_), belongs.astype(np.uint8)
    for axis in range(3):
        lower = tuple(slice(None, -1) if a == axis else slice(None) for a in range(3))
        upper = tuple(slice(1, None) if a == axis else slice(None) for a in range(3))
        all_observed = all_observed[lower] & all_observed[upper]
        belonging = belonging[lower] + belonging[upper]
    cells = np.zeros(observed.shape, dtype=np.bool_)
    cells[1:, 1:, 1:] = all_observed & (belonging >= min_belonging)
    return cells


def _smooth(distance: npt.NDArray[np.floating], voxel: float) -> npt.NDArray[np.bool_]:
    """(X, Y, Z) False at the highest corner of each cell with an edge on which the sign changes over a step too steep.

    Distances along the normal change by at most a voxel from one voxel to the next. Where much more lies between deep
    behind a surface and free space, rays passed beside an edge, and what is behind the edge was never seen. A thin
    board's side, which is not deep, stays. voxel: a voxel in the units of `distance`.
    """
    smooth = np.ones(distance.shape, dtype=np.bool_)
    for axis in range(3):
        d = np.moveaxis(distance, axis, 0)
        low, high = np.minimum(d[1:], d[:-1]), np.maximum(d[1:], d[:-1])
        torn = (low < min(_LEVEL, -DEEP * voxel)) & (high > _LEVEL) & (high - low > MAX_STEP * voxel)
        cells = np.moveaxis(smooth, axis, 0)
        # An edge along the axis belongs to the four cells around it.
        for j, k in ((0, 0), (0, 1), (1, 0), (1, 1)):
            view = cells[1:, j:, k:]
            view &= ~torn[:, : torn.shape[1] - j, : torn.shape[2] - k]
    return smooth


def _surface(
    distance: npt.NDArray[np.floating], cells: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]] | None:
    """Vertices (V, 3) in voxels from the tile's first voxel centre, and faces; None where no surface passes."""
    if not cells.any() or not distance.min() < _LEVEL < distance.max():
        return None
    try:
        vertices, faces, _, _ = marching_cubes(distance, _LEVEL, mask=cells)
    except RuntimeError:  # No surface within the mask.
        return None
    return vertices, faces


def _colors(
    vertices: npt.NDArray[np.float32], tile: _Tile, color: npt.NDArray[np.uint8], colored: npt.NDArray[np.bool_]
) -> npt.NDArray[np.float32]:
    """Colours (V, 3) interpolated along each vertex's edge between the voxels that have one; NaN without any."""
    low = np.floor(vertices).astype(np.int64)
    share = (vertices - low).max(axis=1)
    total, weight = np.zeros(vertices.shape, np.float32), np.zeros(len(vertices), np.float32)
    for voxel, part in ((low, 1 - share), (np.ceil(vertices).astype(np.int64), share)):
        at = (tile.index[tuple((voxel // VOXELS_PER_SIDE).T)], *(voxel % VOXELS_PER_SIDE).T)
        w = np.where(colored[at], np.maximum(part, 1e-3), 0).astype(np.float32)
        total += w[:, None] * color[at]
        weight += w
    return np.divide(total, weight[:, None], out=np.full_like(total, np.nan), where=weight[:, None] > 0)


def _filled(colors: npt.NDArray[np.float32], faces: npt.NDArray[np.int32]) -> npt.NDArray[np.uint8]:
    """Colours with NaN replaced, ring by ring, by the mean of the vertices around."""
    colors = colors.copy()
    near, far = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    for _ in range(_FILL_RINGS):
        gap = np.isnan(colors[:, 0])
        use = gap[near] & ~gap[far]
        if not use.any():
            break
        at, count = near[use], np.bincount(near[use], minlength=len(colors))
        for channel in range(3):
            total = np.bincount(at, colors[far[use], channel], len(colors))
            np.divide(total, count, out=colors[:, channel], where=count > 0, casting="same_kind")
    return np.rint(np.nan_to_num(colors)).astype(np.uint8)


def _joined(
    parts: Sequence[tuple[npt.NDArray[np.floating], npt.NDArray[_C], npt.NDArray[np.int32]]],
) -> tuple[npt.NDArray[np.floating], npt.NDArray[_C], npt.NDArray[np.int32]]:
    """Vertices, colours and faces of all parts, faces renumbered."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts[:-1]])
    faces = [faces + np.int32(start) for (_, _, faces), start in zip(parts, starts, strict=True)]
    return (
        np.concatenate([vertices for vertices, _, _ in parts]),
        np.concatenate([colors for _, colors, _ in parts]),
        np.concatenate(faces).astype(np.int32),
    )


def _welded(
    voxels: npt.NDArray[np.floating], colors: npt.NDArray[_C], faces: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.floating], npt.NDArray[_C], npt.NDArray[np.int32]]:
    """Join the vertices that two tiles have in common."""
    side = _TILE * VOXELS_PER_SIDE
    border = np.flatnonzero((np.abs(voxels - side * np.rint(voxels / side)) < _WELD).any(axis=1))
    pairs = border[KDTree(voxels[border]).query_pairs(_WELD, output_type="ndarray")]
    n = len(voxels)
    graph = coo_array((np.ones(len(pairs), dtype=np.bool_), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    group = connected_components(graph, directed=False)[1]
    _, first = np.unique(group, return_index=True)
    faces = group[faces].astype(np.int32)
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return voxels[first], colors[first], faces[whole]


def _normals(vertices: npt.NDArray[np.float64], faces: npt.NDArray[np.int32]) -> npt.NDArray[np.float32]:
    """Unit normals (V, 3): the faces' around each vertex, weighted by area."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    face = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    corner = faces.ravel()
    normals = np.stack([np.bincount(corner, face[:, i], len(vertices)) for i in range(3)], axis=1)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return (normals / np.where(length > 0, length, 1)).astype(np.float32)
