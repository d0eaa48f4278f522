"""Meshes that follow a running map: only blocks that changed, and those that their change reaches, are meshed again."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import count
from math import inf
from time import perf_counter

import numpy as np
import numpy.typing as npt

from uppm.core.protocols import LiveVoxels
from uppm.core.types import Mesh, Submap, SubmapKind, VoxelBlocks
from uppm.map.mesh import AROUND, SPAN, Keys, Piece, around, block_keys, joined, pieces, positions

Coords = npt.NDArray[np.int32]
_AFTER = np.flatnonzero((AROUND >= 0).all(axis=1))


class SubmapMesher:
    """Keeps the mesh of one submap, block by block."""

    def __init__(self) -> None:
        self._pieces: dict[int, Piece] = {}
        self._keys: Keys = np.empty(0, dtype=np.int64)
        self._grid = (0.0, 0.0)
        self._mesh: tuple[npt.NDArray[np.float64], Mesh] | None = None

    @property
    def mesh(self) -> Mesh | None:
        """As of the last update; None before the first."""
        return self._mesh[1] if self._mesh else None

    def update(self, submap: Submap, coords: Coords, changed: Coords, read: Callable[[Coords], VoxelBlocks]) -> Mesh:
        """The submap's mesh now, equal to one made from all its blocks.

        Parameters
        ----------
        coords : (N, 3)
            Coordinates of all its blocks.
        changed : (M, 3)
            Those of them that were written, or made, since the last call.
        read : gives the voxels of the blocks at some of `coords`, sorted.
        """
        if self._grid != (submap.voxel_size, submap.truncation):
            self._pieces, self._keys, self._grid = {}, self._keys[:0], (submap.voxel_size, submap.truncation)
        keys = np.sort(block_keys(coords))
        gone = np.setdiff1d(self._keys, keys)
        touched, self._keys = np.concatenate([block_keys(changed), gone]), keys
        if len(touched):
            self._remesh(submap, gone, touched, read)
            self._mesh = None
        if self._mesh is None or not np.array_equal(self._mesh[0], submap.T_map_submap):
            self._mesh = submap.T_map_submap.copy(), joined(submap, self._pieces)
        return self._mesh[1]

    def _remesh(self, submap: Submap, gone: Keys, touched: Keys, read: Callable[[Coords], VoxelBlocks]) -> None:
        """A block's vertices depend on the voxels around it; its quads on them, and on the vertices before it."""
        for key in gone.tolist():
            self._pieces.pop(key, None)
        reshaped = self._existing(around(touched))
        requaded = self._existing(around(reshaped)[:, _AFTER])
        if len(requaded):
            blocks = read(_coords(self._existing(around(requaded))))
            self._pieces |= pieces(submap, blocks, reshaped, requaded, self._pieces)

    def _existing(self, keys: Keys) -> Keys:
        unique = np.unique(keys)
        return unique[positions(self._keys, unique) >= 0]


class MapMesher:
    """Keeps the meshes of all submaps of a running map."""

    def __init__(self) -> None:
        self._submaps: dict[int, SubmapMesher] = {}
        self._turns = count(1)
        self._updated: dict[int, int] = {}
        """Submap id -> the turn in which it was last updated."""

    def update(self, submaps: Iterable[Submap], voxels: LiveVoxels, seconds: float = inf) -> dict[int, Mesh]:
        """Surfaces of all submaps but freespace, by id, frame map; what did not change since the last call is kept.

        After so many seconds no further submap is begun: those left keep the mesh that they had, or have none yet, and
        come first the next time.
        """
        solid = [submap for submap in submaps if submap.kind is not SubmapKind.FREESPACE]
        self._submaps = {submap.id: self._submaps.get(submap.id) or SubmapMesher() for submap in solid}
        end = perf_counter() + seconds
        for submap in sorted(solid, key=lambda s: self._updated.get(s.id, 0)):
            self._update(submap, voxels)
            self._updated[submap.id] = next(self._turns)
            if perf_counter() > end:
                break
        return {id_: mesher.mesh for id_, mesher in self._submaps.items() if mesher.mesh is not None}

    def _update(self, submap: Submap, voxels: LiveVoxels) -> Mesh:
        coords, changed = voxels.touched(submap.id)
        return self._submaps[submap.id].update(submap, coords, changed, lambda at: voxels.blocks_at(submap.id, at))


def _coords(keys: Keys) -> Coords:
    side = 2 * SPAN
    return (np.stack([keys // side**2, keys // side % side, keys % side], axis=1) - SPAN).astype(np.int32)
