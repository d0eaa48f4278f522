"""The map seen by a camera: colour, depth, instance and category by casting a ray a pixel into the submaps' TSDFs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm._kernels import raycast
from uppm._kernels.camera import TILE
from uppm.core.errors import InputError
from uppm.core.geometry import invert, transform
from uppm.core.types import Intrinsics, Submap, SubmapKind, SubmapState, VoxelBlocks
from uppm.core.validation import check_pose
from uppm.core.views import RenderedView
from uppm.map.mesh import FULL, around, block_keys, positions
from uppm.map.panoptic_map import PanopticMap

SIDE = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cells:
    """The cells of B blocks that a surface passes through; C in all."""

    coords: npt.NDArray[np.int64]
    """(B, 3), in blocks."""
    tables: npt.NDArray[np.int32]
    """(B, 8, 8, 8): row of each cell, or -1."""
    corners: npt.NDArray[np.float32]
    """(C, 8), distances in voxels."""
    owners: npt.NDArray[np.uint8]
    """(C,): bit c is set where corner c belongs to the submap."""
    colors: npt.NDArray[np.uint8]
    """(C, 8, 3)."""


class Raycaster:
    """Renders a map as it was when this was made; its surfaces' cells are kept, not its voxels.

    A ray ends where it first passes from in front of a surface to behind it: in a cell that the submap's mesh passes
    through too, of a confirmed or inactive submap. A surface seen from behind is not there, as in the pictures of a
    map. Where surfaces of several submaps are on a ray, the nearest counts.

    Parameters
    ----------
    panoptic : the map; all its voxels are read.
    """

    def __init__(self, panoptic: PanopticMap) -> None:
        shown = [s for s in panoptic.submaps if s.kind is not SubmapKind.FREESPACE]
        self._submaps = [s for s in shown if s.state is not SubmapState.TENTATIVE]
        parts = [surface_cells(s, panoptic.blocks(s.id)) for s in self._submaps]
        self._rows = np.repeat(np.arange(len(parts)), [len(part.coords) for part in parts])
        self._cells = _joined(parts)
        self._sizes = np.array([s.voxel_size for s in self._submaps])
        self._low, self._high = _boxes(self._cells)
        centers = ((self._low + self._high) / 2 + 0.5) * self._sizes[self._rows, None]
        self._centers = np.empty((len(centers), 3))
        for row, submap in enumerate(self._submaps):
            own = self._rows == row
            self._centers[own] = transform(submap.T_map_submap, centers[own])
        self._radii = np.linalg.norm(self._high - self._low, axis=1) / 2 * self._sizes[self._rows]

    def render(
        self,
        T_map_camera: npt.NDArray[np.float64],
        intrinsics: Intrinsics,
        *,
        depth_range: tuple[float, float] = (0.05, 100.0),
    ) -> RenderedView:
        """The map from one place.

        Parameters
        ----------
        T_map_camera : (4, 4).
        depth_range : least and greatest depth of what is drawn, metres.

        Raises
        ------
        InputError
            The pose is not finite and rigid, or the range is empty.
        """
        check_pose("T_map_camera", T_map_camera)
        if not 0 < depth_range[0] < depth_range[1]:
            found, advice = f"{depth_range[0]:g} to {depth_range[1]:g}", "give two depths in metres"
            raise InputError("depth range", expected="0 < least < greatest", found=found, advice=advice)
        shape = (intrinsics.height, intrinsics.width)
        depth, index = np.zeros(shape, dtype=np.float32), np.full(shape, -1, dtype=np.int32)
        color = np.zeros((*shape, 3), dtype=np.uint8)
        T_camera_map, camera = invert(T_map_camera), (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
        centers = transform(T_camera_map, self._centers)
        nearest = centers[:, 2] - self._radii
        starts, ends, listed = _tiles(centers, self._radii, nearest, camera, shape)
        rotations, origins = self._camera_in_submaps(T_map_camera)
        raycast.cast(
            starts, ends, listed, nearest, self._rows, self._cells.tables, self._cells.corners, self._cells.owners,
            self._cells.colors, self._low, self._high, rotations, origins, self._sizes,
            (np.arange(shape[1]) - camera[2]) / camera[0], (np.arange(shape[0]) - camera[3]) / camera[1],
            np.array(depth_range), depth, index, color,
        )  # fmt: skip
        categories = [s.descriptor.category.id if s.descriptor else 0 for s in self._submaps]
        return RenderedView(
            color=color,
            depth=depth,
            instance=np.array([*(s.id for s in self._submaps), 0], dtype=np.int32)[index],
            category=np.array([*categories, 0], dtype=np.int32)[index],
            T_map_camera=T_map_camera,
            intrinsics=intrinsics,
        )

    def _camera_in_submaps(
        self, T_map_camera: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Camera axes (S, 3, 3) and place (S, 3) in voxels of each submap, from voxel (0, 0, 0)'s centre."""
        poses = np.array([invert(s.T_map_submap) @ T_map_camera for s in self._submaps]).reshape(-1, 4, 4)
        sizes = self._sizes[:, None]
        return poses[:, :3, :3] / sizes[..., None], poses[:, :3, 3] / sizes - 0.5


def surface_cells(submap: Submap, blocks: VoxelBlocks) -> _Cells:
    """The cells of a submap's voxels that its own surface passes through; blocks without any are left out."""
    keys = block_keys(blocks.coords)
    near, scale = positions(keys, around(keys)), np.float32(submap.truncation / submap.voxel_size / FULL)
    given = near, blocks.distance, blocks.weight, blocks.color, blocks.belonging, scale
    tables, counts = np.empty((len(blocks), SIDE, SIDE, SIDE), dtype=np.int32), np.zeros(len(blocks), dtype=np.int64)
    raycast.surface_cells(*given, tables, counts, counts, *_room(0))
    starts, room = np.cumsum(counts) - counts, _room(int(counts.sum()))
    raycast.surface_cells(*given, tables, counts, starts, *room)
    tables = np.where(tables >= 0, tables + starts[:, None, None, None], -1).astype(np.int32)
    kept, (corners, owners, colors) = np.flatnonzero(counts), room
    coords = blocks.coords[kept].astype(np.int64)
    return _Cells(coords=coords, tables=tables[kept], corners=corners, owners=owners, colors=colors)


def _room(count: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Corners, owners and colours of so many cells, to be written."""
    shape = (count, 8)
    return np.empty(shape, np.float32), np.empty(count, np.uint8), np.empty((*shape, 3), np.uint8)


def _joined(parts: Sequence[_Cells]) -> _Cells:
    starts = np.cumsum([0] + [len(part.corners) for part in parts])
    tables = [np.where(p.tables >= 0, p.tables + start, -1) for p, start in zip(parts, starts, strict=False)]
    return _Cells(
        coords=np.concatenate([np.empty((0, 3), dtype=np.int64), *(p.coords for p in parts)]),
        tables=np.concatenate([np.empty((0, SIDE, SIDE, SIDE)), *tables]).astype(np.int32),
        corners=np.concatenate([np.empty((0, 8), dtype=np.float32), *(p.corners for p in parts)]),
        owners=np.concatenate([np.empty(0, dtype=np.uint8), *(p.owners for p in parts)]),
        colors=np.concatenate([np.empty((0, 8, 3), dtype=np.uint8), *(p.colors for p in parts)]),
    )


def _boxes(cells: _Cells) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Lowest and highest corner (B, 3) of each block's cells, in voxels from voxel (0, 0, 0)'s centre."""
    low, high = cells.coords * SIDE, cells.coords * SIDE
    for axis in range(3):
        layers = np.moveaxis(cells.tables, axis + 1, 1).reshape(len(low), SIDE, SIDE * SIDE)
        along = np.asarray(layers.max(axis=2) >= 0)
        low[:, axis] += along.argmax(axis=1)
        high[:, axis] += SIDE - np.flip(along, axis=1).argmax(axis=1)
    return low, high


def _tiles(
    centers: npt.NDArray[np.float64],
    radii: npt.NDArray[np.float64],
    nearest: npt.NDArray[np.float64],
    camera: tuple[float, float, float, float],
    shape: tuple[int, int],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """The blocks of each tile, the nearest first: where each tile's begin and end (T, T'), and their numbers."""
    order, boxes = np.argsort(nearest, kind="stable"), np.empty((len(centers), 4), dtype=np.int64)
    counts = np.zeros((-(-shape[0] // TILE), -(-shape[1] // TILE)), dtype=np.int64)
    raycast.bin_blocks(order, centers, radii, camera, shape, boxes, counts)
    ends = np.cumsum(counts).reshape(counts.shape)
    moving, listed = ends - counts, np.empty(int(counts.sum()), dtype=np.int64)
    raycast.fill_tiles(order, boxes, moving, listed)
    return ends - counts, ends, listed
