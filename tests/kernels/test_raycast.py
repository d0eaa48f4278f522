"""The kernels that cast rays against their NumPy references: cells, hits, and whose surface counts."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.test_meshing import CONSTANTS, field_of
from tests.map.scenes import CUP, submap_of
from tests.scenes import look_at
from uppm._kernels import raycast, reference_rays
from uppm.core.geometry import invert, rays
from uppm.core.types import Intrinsics, Submap, VoxelBlocks
from uppm.map.panoptic_map import PanopticMap
from uppm.map.raycast import Raycaster, surface_cells

CAMERA = Intrinsics(fx=42.0, fy=45.0, cx=23.0, cy=17.5, width=48, height=36)
LIMITS = (0.05, 3.0)
STORED = 2 / 32767
"""Voxels a unit of distance."""


class Dense:
    """A submap of two blocks a side, as dense arrays and as blocks."""

    def __init__(self, seed: int, submap: Submap) -> None:
        rng = np.random.default_rng(seed)
        field, self.submap = field_of(seed), submap
        stored = np.rint(np.nan_to_num(field) / 2 * 32767)
        self.field = np.where(np.isnan(field), np.nan, (stored + 0.5) * STORED)
        self.belonging = rng.integers(0, 4, (16, 16, 16, 2)).astype(np.uint8)
        self.color = rng.integers(0, 256, (16, 16, 16, 3)).astype(np.uint8)
        self.color[rng.random((16, 16, 16)) < 0.3] = 0
        seen = (~np.isnan(field)).astype(np.float32)
        self.blocks = VoxelBlocks(
            coords=np.array(list(np.ndindex(2, 2, 2)), dtype=np.int32),
            distance=tiles(stored.astype(np.int16)),
            weight=tiles(seen),
            color=tiles(self.color),
            belonging=tiles(self.belonging),
        )
        self.cells = reference_rays.surface_cells(
            self.field, self.color, self.belonging, {**CONSTANTS, "ROUNDING": float(raycast.ROUNDING)}
        )


def tiles(dense: np.ndarray) -> np.ndarray:
    """(8, 8, 8, 8, ...) blocks of a dense array (16, 16, 16, ...)."""
    split = dense.reshape(2, 8, 2, 8, 2, 8, *dense.shape[3:])
    return np.ascontiguousarray(np.moveaxis(split, (2, 4), (1, 2)).reshape(8, 8, 8, 8, *dense.shape[3:]))


@pytest.fixture(scope="module")
def scene() -> list[Dense]:
    turned = look_at([0.4, 0.1, 0.2], [0.6, 0.5, -0.1])
    submaps = [submap_of(1, CUP, voxel=0.05), submap_of(2, CUP, voxel=0.03)]
    object.__setattr__(submaps[0], "T_map_submap", np.eye(4))
    object.__setattr__(submaps[1], "T_map_submap", turned)
    return [Dense(seed, submap) for seed, submap in enumerate(submaps)]


def test_surface_cells_agree_with_the_reference(scene: list[Dense]) -> None:
    for part in scene:
        found = surface_cells(part.submap, part.blocks)
        rows = {
            tuple((8 * coord + cell).tolist()): found.tables[(n, *cell)]
            for n, coord in enumerate(found.coords)
            for cell in np.ndindex(8, 8, 8)
            if found.tables[(n, *cell)] >= 0
        }
        assert {cell for cell in rows if max(cell) < 15} == set(part.cells)
        assert len(part.cells) > 400
        for cell, (corners, own, colors) in part.cells.items():
            np.testing.assert_allclose(found.corners[rows[cell]], corners, atol=2e-3)
            assert found.owners[rows[cell]] == own @ (1 << np.arange(8))
            np.testing.assert_array_equal(found.colors[rows[cell]], colors)


@pytest.mark.parametrize("eye", [[-0.5, 0.2, 0.6], [0.4, 0.4, 0.4], [1.4, 0.9, 0.1]])
def test_rays_agree_with_the_reference(scene: list[Dense], eye: list[float]) -> None:
    voxels = {part.submap.id: part.blocks for part in scene}
    caster = Raycaster(PanopticMap(submaps=[part.submap for part in scene], voxels=Voxels(voxels)))
    pose = look_at(eye, [0.45, 0.35, 0.3])
    view = caster.render(pose, CAMERA, depth_range=LIMITS)
    depth, instance, color = expected_view(scene, pose)
    same = view.instance == instance
    assert same.mean() > 0.999  # A ray along the side of a cell may fall to either.
    np.testing.assert_allclose(view.depth[same], depth[same], atol=1e-5)
    assert np.abs(view.color[same].astype(int) - color[same]).max() <= 1
    assert (np.unique(instance) == [0, 1, 2]).all()


class Voxels:
    def __init__(self, parts: dict[int, VoxelBlocks]) -> None:
        self.parts = parts

    def blocks(self, submap_id: int) -> VoxelBlocks:
        return self.parts[submap_id]


def expected_view(scene: list[Dense], pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth, submap id and colour of each pixel, by the references."""
    directions = rays(CAMERA).reshape(-1, 3).astype(np.float64)
    reach, depth = np.full(len(directions), LIMITS[1]), np.zeros(len(directions))
    instance, color = np.zeros(len(directions), dtype=int), np.zeros((len(directions), 3))
    for part in scene:
        size, found = part.submap.voxel_size, surface_cells(part.submap, part.blocks)
        camera = invert(part.submap.T_map_submap) @ pose
        origin, turned = camera[:3, 3] / size - 0.5, directions @ camera[:3, :3].T / size
        for coord, table in zip(found.coords, found.tables, strict=True):
            rows, cells = table[table >= 0], 8 * coord + np.argwhere(table >= 0)
            hits = reference_rays.first_hits(
                found.corners[rows], cells, origin, turned, np.array(LIMITS), raycast.STEPS
            )
            nearest = hits.argmin(axis=0)
            for pixel in np.flatnonzero(np.isfinite(hits.min(axis=0))):
                n, hit = nearest[pixel], hits[nearest[pixel], pixel]
                place = (origin - cells[n] + hit * turned[pixel])[None]
                own = (found.owners[rows[n]] >> np.arange(8) & 1).astype(float)
                farther = hit + (1 - reference_rays.trilinear(own, place)[0]) * size
                if farther < reach[pixel]:
                    reach[pixel], depth[pixel], instance[pixel] = farther, hit, part.submap.id
                    color[pixel] = np.floor(reference_rays.trilinear(found.colors[rows[n]], place)[0] + 0.5)
    shape = (CAMERA.height, CAMERA.width)
    return depth.reshape(shape), instance.reshape(shape), color.reshape(*shape, 3)
