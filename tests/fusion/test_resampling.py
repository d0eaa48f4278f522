"""A sphere on other grids: finer, coarser, turned, and two halves put together."""

from __future__ import annotations

import numpy as np
import pytest

from uppm._kernels.reference import voxel_centers
from uppm.core.geometry import invert, transform
from uppm.core.types import VoxelBlocks
from uppm.fusion.resampling import FULL, combine, keep, resample

CENTER, RADIUS = np.array([0.31, -0.12, 0.27]), 0.4


def sphere(size: float) -> VoxelBlocks:
    """All blocks around a sphere, every voxel observed."""
    reach = int(np.ceil((RADIUS + 0.3) / (8 * size))) + 1
    middle = np.floor(CENTER / (8 * size)).astype(int)
    around = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    coords = np.unique(around + middle, axis=0).astype(np.int32)
    distance = np.linalg.norm(voxel_centers(coords, size) - CENTER, axis=-1) - RADIUS
    shape = distance.shape
    return VoxelBlocks(
        coords=coords,
        distance=np.rint(np.clip(distance / (2 * size), -1, 1) * FULL).astype(np.int16),
        weight=np.ones(shape, dtype=np.float32),
        color=np.full((*shape, 3), 90, dtype=np.uint8),
        belonging=np.full((*shape, 2), (3, 1), dtype=np.uint8),
    )


def error(blocks: VoxelBlocks, size: float, T_sphere_blocks: np.ndarray) -> np.ndarray:
    """Distance of each observed voxel less the true one, metres, within a voxel of the surface."""
    centers = transform(T_sphere_blocks, voxel_centers(blocks.coords, size).reshape(-1, 3)).reshape(
        *blocks.weight.shape, 3
    )
    true = np.linalg.norm(centers - CENTER, axis=-1) - RADIUS
    got = blocks.distance.astype(float) * (2 * size) / FULL
    near = (np.abs(true) < 0.8 * size) & (blocks.weight > 0)
    # A sphere's shell, two times 0.8 voxels thick, in voxels.
    assert near.sum() > 0.9 * 4 * np.pi * RADIUS**2 * 1.6 * size / size**3
    return (got - true)[near]


@pytest.mark.parametrize(("old", "new"), [(0.05, 0.02), (0.05, 0.03), (0.03, 0.02), (0.02, 0.03), (0.02, 0.05)])
def test_the_surface_is_kept_whole(old: float, new: float) -> None:
    blocks = resample(sphere(old), old, 2 * old, new, 2 * new)
    assert np.abs(error(blocks, new, np.eye(4))).max() < 0.25 * max(old, new)
    assert (blocks.belonging[blocks.weight > 0] == (3, 1)).all()
    assert (blocks.color[blocks.weight > 0] == 90).all()


def test_into_a_turned_frame() -> None:
    turn = np.array([[0.6, -0.8, 0, 0.5], [0.8, 0.6, 0, -0.2], [0, 0, 1, 0.1], [0, 0, 0, 1.0]])
    blocks = resample(sphere(0.03), 0.03, 0.06, 0.03, 0.06, turn)
    assert np.abs(error(blocks, 0.03, turn)).max() < 0.25 * 0.03
    back = resample(blocks, 0.03, 0.06, 0.03, 0.06, invert(turn))
    assert np.abs(error(back, 0.03, np.eye(4))).max() < 0.5 * 0.03


def test_two_halves_are_the_whole() -> None:
    whole = sphere(0.05)
    left = whole.coords[:, 0] < 1
    both = combine(keep(whole, left), keep(whole, ~left))
    np.testing.assert_array_equal(both.coords, whole.coords)
    np.testing.assert_array_equal(both.distance, whole.distance)
    twice = combine(whole, whole)
    np.testing.assert_array_equal(twice.distance, whole.distance)
    assert (twice.weight == 2).all()
    assert (twice.belonging == (6, 1)).all()
