"""Rendered views against analytic truth, and whose surface is seen where several are."""

from __future__ import annotations

import numpy as np
import pytest

from tests.map.scenes import CHAIR, CUP, WALL, blocks_of, plane, sphere, submap_of
from tests.scenes import CAMERA, Plane, Sphere, look_at
from tests.scenes import render as measured
from uppm.core.errors import InputError
from uppm.core.geometry import transform
from uppm.core.types import Submap, SubmapKind, SubmapState, VoxelBlocks
from uppm.map.panoptic_map import PanopticMap
from uppm.map.raycast import Raycaster

SHIFT = submap_of(1).T_map_submap[:3, 3]
CENTER, RADIUS = np.array([0.1, 0.0, 0.02]), 0.2
FLOOR = -0.31
EYE = SHIFT + np.array([-1.1, 0.25, 0.7])
POSE = look_at(EYE, SHIFT)


class Voxels:
    def __init__(self, parts: dict[int, VoxelBlocks]) -> None:
        self.parts = parts

    def blocks(self, submap_id: int) -> VoxelBlocks:
        return self.parts[submap_id]


def ball(voxel: float = 0.02) -> VoxelBlocks:
    return blocks_of(sphere(CENTER.tolist(), RADIUS), (-0.4,) * 3, (0.6,) * 3, voxel)


def floor(height: float = FLOOR) -> VoxelBlocks:
    return blocks_of(plane((0, 0, 1), height), (-2.5, -2.5, -0.8), (4, 2.5, 0.4), 0.05)


def caster(*parts: tuple[Submap, VoxelBlocks]) -> Raycaster:
    voxels = Voxels({submap.id: blocks for submap, blocks in parts})
    return Raycaster(PanopticMap(submaps=[submap for submap, _ in parts], voxels=voxels))


BALL, GROUND = submap_of(7, CUP), submap_of(9, WALL, kind=SubmapKind.BACKGROUND, voxel=0.05)


def test_a_sphere_on_a_plane_is_where_it_is() -> None:
    view = caster((BALL, ball()), (GROUND, floor())).render(POSE, CAMERA)
    shapes = [Sphere(SHIFT + CENTER, RADIUS), Plane([0, 0, 1], SHIFT[2] + FLOOR)]
    truth, ids = measured(shapes, POSE)
    within = (ids == 1) | ((ids == 2) & (truth.depth < 2.2))
    assert (view.depth[within] > 0).mean() > 0.995
    assert (view.instance[within] == np.array([0, 7, 9])[ids[within]]).mean() > 0.985
    right = within & (view.instance == np.array([0, 7, 9])[ids])
    error = np.abs(view.depth - truth.depth)[right]
    assert np.median(error[ids[right] == 2]) < 1e-4
    assert np.median(error[ids[right] == 1]) < 1e-3
    assert np.quantile(error, 0.98) < 0.01
    np.testing.assert_array_equal(view.category > 0, view.depth > 0)
    assert set(np.unique(view.category)) <= {0, CUP.id, WALL.id}


def test_colours_are_those_of_the_voxels() -> None:
    view = caster((BALL, ball())).render(POSE, CAMERA)
    seen = view.depth > 0
    v, u = np.nonzero(seen)
    z = view.depth[seen].astype(np.float64)
    points = np.stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z], axis=1)
    expected = 128 + 100 * np.sin(5 * (transform(POSE, points) - SHIFT))
    assert np.abs(view.color[seen] - expected).max() < 3


def test_the_nearest_surface_wins() -> None:
    high = submap_of(8, CHAIR, voxel=0.05)
    view = caster((BALL, ball()), (GROUND, floor()), (high, floor(0.25))).render(POSE, CAMERA)
    truth, _ = measured([Plane([0, 0, 1], SHIFT[2] + 0.25)], POSE)
    near = (truth.depth > 0) & (truth.depth < 1.5)
    assert (view.instance[near] == 8).all()
    np.testing.assert_allclose(view.depth[near], truth.depth[near], atol=1e-3)


def foreign(blocks: VoxelBlocks, others: np.ndarray) -> VoxelBlocks:
    """The blocks with some voxels (N, 8, 8, 8) that belong to another submap."""
    belonging = blocks.belonging.copy()
    belonging[others] = (1, 4)
    return VoxelBlocks(
        coords=blocks.coords,
        distance=blocks.distance,
        weight=blocks.weight,
        color=blocks.color,
        belonging=belonging,
    )


def test_what_belongs_to_another_is_not_shown() -> None:
    """Two submaps hold the same plane; each owns one side of a line."""
    one, two = submap_of(3, CUP, voxel=0.05), submap_of(4, CHAIR, voxel=0.05)
    blocks = floor()
    x = (8 * blocks.coords[:, 0, None] + np.arange(8) + 0.5) * 0.05
    right = np.broadcast_to((x > 0)[:, :, None, None], blocks.weight.shape)
    view = caster((one, foreign(blocks, right)), (two, foreign(blocks, ~right))).render(POSE, CAMERA)
    v, u = np.nonzero(view.depth > 0)
    z = view.depth[v, u].astype(np.float64)
    points = np.stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z], axis=1)
    side = (transform(POSE, points) - SHIFT)[:, 0]
    clear = np.abs(side) > 0.03
    np.testing.assert_array_equal(view.instance[v, u][clear], np.where(side[clear] > 0, 4, 3))
    alone = caster((one, foreign(blocks, right))).render(POSE, CAMERA)
    far = np.zeros(view.depth.shape, dtype=bool)
    far[v[side > 0.06], u[side > 0.06]] = True
    assert not alone.depth[far].any()


def test_a_surface_from_behind_is_not_there() -> None:
    below = look_at(SHIFT + np.array([-1.0, 0.0, FLOOR - 0.6]), SHIFT + np.array([0.0, 0.0, FLOOR]))
    assert not caster((GROUND, floor())).render(below, CAMERA).depth.any()
    inside = look_at(SHIFT + CENTER, SHIFT + CENTER + [1, 0.2, 0.1])
    assert not caster((BALL, ball())).render(inside, CAMERA).depth.any()


def test_only_what_the_map_believes_is_shown() -> None:
    tentative = submap_of(7, CUP, state=SubmapState.TENTATIVE)
    freespace = submap_of(9, None, kind=SubmapKind.FREESPACE, voxel=0.05)
    assert not caster((tentative, ball()), (freespace, floor())).render(POSE, CAMERA).depth.any()
    unlabeled = caster((submap_of(9, None, kind=SubmapKind.BACKGROUND, voxel=0.05), floor())).render(POSE, CAMERA)
    assert set(np.unique(unlabeled.instance)) == {0, 9}
    assert not unlabeled.category.any()


def test_the_depth_range_cuts() -> None:
    whole = caster((GROUND, floor()))
    depth = whole.render(POSE, CAMERA).depth
    cut = whole.render(POSE, CAMERA, depth_range=(0.05, 1.5)).depth
    np.testing.assert_array_equal(cut, np.where(depth < 1.5, depth, 0))
    with pytest.raises(InputError, match="expected 0 < least < greatest, found 2 to 1"):
        whole.render(POSE, CAMERA, depth_range=(2, 1))
    with pytest.raises(InputError, match="rigid"):
        whole.render(2 * POSE, CAMERA)


def test_a_map_of_nothing_is_seen_as_nothing() -> None:
    view = caster().render(POSE, CAMERA)
    assert view.depth.shape == (CAMERA.height, CAMERA.width)
    assert not view.color.any()
    assert not view.instance.any()
