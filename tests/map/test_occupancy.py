"""A ball over a floor in measured freespace: what is occupied, free and unknown, how far from it, and at what cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from tests.map.scenes import SignedDistance, blocks_of, box, plane, sphere, submap_of
from uppm.core.categories import category_by_name
from uppm.core.errors import InputError
from uppm.core.geometry import invert, transform
from uppm.core.types import Submap, SubmapKind, VoxelBlocks
from uppm.map.boxes import upright_box
from uppm.map.costmap import UNKNOWN_COST, inflation, semantic_costmap
from uppm.map.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, distance_field, occupancy_grid
from uppm.map.panoptic_map import PanopticMap
from uppm.map.store import MapMeta

RESOLUTION = 0.05
CHAIR, CUP, FLOOR = (category_by_name()[name] for name in ("chair", "cup", "floor-wood"))
BALL, RADIUS = (0.1, 0.0, 0.6), 0.3


class Voxels:
    def __init__(self, blocks: Mapping[int, VoxelBlocks]) -> None:
        self._blocks = blocks

    def blocks(self, submap_id: int) -> VoxelBlocks:
        return self._blocks[submap_id]


def scene(up: str = "0 0 1") -> PanopticMap:
    """Submaps' own frame is moved by (0.5, -0.25, 1.0); the floor is at z = 0 there."""
    reach = (-1.2, -1.2, -0.3), (1.2, 1.2, 1.5)
    shapes: dict[int, tuple[Submap, SignedDistance]] = {
        1: (submap_of(1, CHAIR, voxel=0.03), sphere(BALL, RADIUS)),
        2: (submap_of(2, FLOOR, kind=SubmapKind.BACKGROUND, voxel=0.05), plane((0, 0, 1), 0.0)),
    }
    blocks = {id_: blocks_of(shape, *reach, submap.voxel_size) for id_, (submap, shape) in shapes.items()}
    submaps = [submap for submap, _ in shapes.values()]
    submaps.append(submap_of(3, None, kind=SubmapKind.FREESPACE, voxel=0.3))
    blocks[3] = freespace(*reach)
    return PanopticMap(submaps=submaps, voxels=Voxels(blocks), meta=MapMeta(provenance={"up": up}))


def freespace(low: Sequence[float], high: Sequence[float]) -> VoxelBlocks:
    ground, ball, hole = plane((0, 0, 1), 0.0), sphere(BALL, RADIUS), box((-2, 0.9, -1), (2, 3, 3))
    blocks = blocks_of(lambda p: np.minimum(ground(p), ball(p)), low, high, 0.3)
    points = (8 * blocks.coords[:, None, None, None, :] + np.moveaxis(np.indices((8, 8, 8)), 0, -1) + 0.5) * np.float64(
        0.3
    )
    weight = np.where(hole(points) < 0, 0, blocks.weight).astype(np.float32)
    return VoxelBlocks(
        coords=blocks.coords, distance=blocks.distance, weight=weight, color=blocks.color, belonging=blocks.belonging
    )


@pytest.fixture(scope="module")
def grid() -> OccupancyGrid:
    return occupancy_grid(scene(), RESOLUTION)


def local_centers(grid: OccupancyGrid, panoptic: PanopticMap) -> np.ndarray:
    """Cell centres in the submaps' frame."""
    index = np.moveaxis(np.indices(grid.state.shape), 0, -1)
    in_grid = grid.origin + (index + 0.5) * grid.resolution
    return transform(invert(grid.T_grid_map @ panoptic.submaps[0].T_map_submap), in_grid)


@pytest.mark.parametrize("up", ["0 0 1", "0.6 0 0.8", "0 0 -1"])
def test_cells_are_what_they_are(up: str) -> None:
    panoptic = scene(up)
    grid = occupancy_grid(panoptic, RESOLUTION)
    p = local_centers(grid, panoptic)
    ball = np.linalg.norm(p - BALL, axis=-1) - RADIUS
    diagonal = RESOLUTION * np.sqrt(3) / 2
    inside = (np.abs(p[..., :2]) < 1.0).all(axis=-1) & (p[..., 2] < 1.2) & (p[..., 2] > -0.2)
    surface = np.minimum(np.abs(ball), np.abs(p[..., 2]))
    assert (surface[inside & (grid.state == OCCUPIED)] < diagonal + 0.01).all()
    assert (grid.state[inside & (surface < 0.3 * RESOLUTION)] == OCCUPIED).mean() > 0.98
    air = inside & (np.minimum(ball, p[..., 2]) > 0.1) & (p[..., 1] < 0.6)
    assert (grid.state[air] == FREE).mean() > 0.98
    assert not (grid.state[(ball < -0.05) & (ball > -0.09)] == FREE).any()
    assert (grid.state[(p[..., 1] > 1.1) & (p[..., 2] > 0.4) & (ball > 0.2)] == UNKNOWN).all()
    assert set(np.unique(grid.category[grid.state == OCCUPIED])) == {CHAIR.id, FLOOR.id}
    assert not grid.category[grid.state != OCCUPIED].any()


def test_heights_count_from_the_floor(grid: OccupancyGrid) -> None:
    assert grid.floor == pytest.approx(1.0, abs=0.02)
    high = grid.plan(0.2, 1.0)
    x, y = (np.indices(high.shape) + 0.5) * RESOLUTION + grid.origin[:2, None, None]
    around = np.hypot(x - 0.6, y + 0.25)
    assert (high[around < RADIUS - 0.06] == OCCUPIED).all()
    assert (high[(around > RADIUS + 0.06) & (y < 0.2)] == FREE).mean() > 0.97
    assert (grid.plan(-0.1, 0.1)[around < 0.8] == OCCUPIED).mean() > 0.95
    with pytest.raises(
        InputError, match=r"height band: expected heights over the floor, found 7 to 8 m, where the map"
    ):
        grid.plan(7, 8)


def test_distances_are_exact() -> None:
    rng = np.random.default_rng(5)
    state = np.where(rng.random((9, 8, 7)) < 0.1, OCCUPIED, FREE).astype(np.int8)
    field = distance_field(state, 0.1)
    cells = np.stack(np.nonzero(np.ones_like(state)), axis=1)
    taken, left = cells[state.ravel() == OCCUPIED], cells[state.ravel() != OCCUPIED]
    for cell, found in zip(cells, field.ravel(), strict=True):
        others, sign = (left, -1) if state[tuple(cell)] == OCCUPIED else (taken, 1)
        assert found == pytest.approx(sign * 0.1 * np.linalg.norm(others - cell, axis=1).min(), abs=1e-5)
    assert np.isinf(distance_field(np.zeros((2, 2, 2), np.int8), 0.1)).all()


def test_costs_reach_as_far_as_the_category_says(grid: OccupancyGrid) -> None:
    for radius in (0.2, 0.6):
        costs = semantic_costmap(grid, 0.2, 1.0, {"chair": radius})
        x, y = (np.indices(costs.shape) + 0.5) * RESOLUTION + grid.origin[:2, None, None]
        beyond = np.hypot(x - 0.6, y + 0.25) - RADIUS
        assert (costs[beyond < -0.06] == 100).all()
        at_half = costs[np.abs(beyond - radius / 2) < 0.02].astype(float)
        np.testing.assert_allclose(at_half, 50, atol=100 * 0.06 / radius)
        assert set(np.unique(costs[beyond > radius + 0.1])) <= {0, UNKNOWN_COST}
    assert UNKNOWN_COST in costs
    assert inflation(CHAIR.id, {}) == 0.35
    assert inflation(CUP.id, {"kitchen": 0.7}) == 0.7
    assert inflation(CUP.id, {}) == inflation(0, {}) == 0.3
    with pytest.raises(InputError, match="inflation: expected a unified category, found 'chiar'"):
        semantic_costmap(grid, 0.2, 1.0, {"chiar": 1})


def test_maps_that_make_no_grid_say_so() -> None:
    empty = PanopticMap(submaps=[], voxels=Voxels({}))
    with pytest.raises(InputError, match="expected a map with surfaces"):
        occupancy_grid(empty)
    with pytest.raises(InputError, match=r"at most 400000000 cells, found \d+ x \d+ x \d+; choose larger cells"):
        occupancy_grid(scene(), 0.001)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (0.6, 0, 0.8)])
def test_upright_boxes_are_turned_as_the_object_stands(up: tuple[float, float, float]) -> None:
    rng, vertical = np.random.default_rng(2), np.asarray(up, dtype=np.float64)
    side = np.cross(vertical, [0.3, 0.5, 0.1])
    side /= np.linalg.norm(side)
    axes = np.column_stack([side, np.cross(vertical, side), vertical])
    size, center = np.array([1.2, 0.5, 0.8]), np.array([1.0, -2.0, 0.4])
    local = rng.uniform(-0.5, 0.5, (4000, 3))
    local[np.arange(4000), rng.integers(0, 3, 4000)] = rng.choice([-0.5, 0.5], 4000)
    found = upright_box(center + local * size @ axes.T, vertical)
    assert found is not None
    np.testing.assert_allclose(found.size, size, atol=0.01)
    np.testing.assert_allclose(found.center, center, atol=0.01)
    np.testing.assert_allclose(np.abs((found.R_map_box * axes).sum(axis=0)), 1, atol=1e-3)
    np.testing.assert_allclose(found.R_map_box.T @ found.R_map_box, np.eye(3), atol=1e-9)
    assert np.linalg.norm(found.corners - found.center, axis=1) == pytest.approx(np.linalg.norm(found.size) / 2)
    assert set(found.to_dict()) == {"center", "size", "axes"}
    assert upright_box(np.zeros((2, 3)), vertical) is None
