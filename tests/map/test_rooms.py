"""Rooms of constructed floor plans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.map.scenes import blocks_of, checkpoint_of, plane, submap_of
from uppm.core.categories import category_by_name
from uppm.core.errors import InputError
from uppm.core.types import SubmapKind
from uppm.map import occupancy
from uppm.map.panoptic_map import PanopticMap
from uppm.map.rooms import nearest_rooms, room_of, segment_rooms
from uppm.map.scene import Scene
from uppm.map.store import MapReader, MapWriter

CELL = 0.05


def plan_of(width: float, depth: float) -> np.ndarray:
    return np.zeros((round(width / CELL), round(depth / CELL)), dtype=np.bool_)


def carve(plan: np.ndarray, x0: float, y0: float, x1: float, y1: float) -> None:
    plan[round(x0 / CELL) : round(x1 / CELL), round(y0 / CELL) : round(y1 / CELL)] = True


def at(rooms: np.ndarray, x: float, y: float) -> int:
    return int(rooms[int(x / CELL), int(y / CELL)])


@pytest.fixture
def two() -> np.ndarray:
    """4 m x 4 m and 3 m x 4 m, a doorway of 0.9 m in the wall between them."""
    plan = plan_of(8, 4.4)
    carve(plan, 0.2, 0.2, 4.2, 4.2)
    carve(plan, 4.4, 0.2, 7.4, 4.2)
    carve(plan, 4.2, 1.0, 4.4, 1.9)
    return plan


def test_a_doorway_divides_rooms(two: np.ndarray) -> None:
    rooms = segment_rooms(two, CELL)
    assert rooms.max() == 2
    assert at(rooms, 1, 1) == at(rooms, 4, 4) == at(rooms, 3.9, 0.4) == 1
    assert at(rooms, 5, 1) == at(rooms, 7, 4) == 2
    assert (rooms > 0).sum() == two.sum()


def test_a_wide_passage_does_not(two: np.ndarray) -> None:
    carve(two, 4.2, 1.0, 4.4, 3.0)
    assert segment_rooms(two, CELL).max() == 1


def test_an_l_shaped_room_is_one() -> None:
    plan = plan_of(6, 6)
    carve(plan, 0.2, 0.2, 5.8, 2.7)
    carve(plan, 0.2, 0.2, 2.7, 5.8)
    assert segment_rooms(plan, CELL).max() == 1


def test_a_corridor_is_a_room_although_it_is_narrow() -> None:
    plan = plan_of(8, 6)
    carve(plan, 0.2, 0.2, 7.8, 1.4)
    carve(plan, 0.2, 1.6, 3.8, 5.6)
    carve(plan, 4.0, 1.6, 7.8, 5.6)
    carve(plan, 1.5, 1.4, 2.3, 1.6)
    carve(plan, 5.5, 1.4, 6.3, 1.6)
    rooms = segment_rooms(plan, CELL)
    assert rooms.max() == 3
    assert at(rooms, 0.5, 0.8) == at(rooms, 7.5, 0.8) == at(rooms, 4.0, 0.5)


def test_ragged_walls_and_holes_make_no_rooms(two: np.ndarray) -> None:
    rng = np.random.default_rng(3)
    edge = two & (rng.random(two.shape) < 0.002)
    edge |= two & ~np.roll(two, 1, axis=0) & (rng.random(two.shape) < 0.5)
    assert segment_rooms(two & ~edge, CELL).max() == 2


def test_nothing_free_has_no_rooms() -> None:
    rooms = segment_rooms(plan_of(2, 2), CELL)
    assert rooms.max() == 0
    assert room_of(np.zeros((1, 2)), nearest_rooms(rooms), np.zeros(2), CELL) == 0


def test_an_object_is_in_the_room_of_most_of_its_points(two: np.ndarray) -> None:
    rooms = nearest_rooms(segment_rooms(two, CELL))
    origin = np.array([-1.0, 2.0])
    points = np.array([[5.0, 1.0], [5.1, 1.0], [4.0, 1.0]]) + origin
    assert room_of(points, rooms, origin, CELL) == 2
    assert room_of(np.array([[0.05, 1.0], [-3.0, 1.0]]) + origin, rooms, origin, CELL) == 1  # In the wall, and outside.


@pytest.fixture
def floor_only(tmp_path: Path) -> PanopticMap:
    """A map that reaches nowhere near the heights of the plan."""
    floor = submap_of(1, category_by_name()["floor-wood"], kind=SubmapKind.BACKGROUND, voxel=0.05)
    blocks = blocks_of(plane((0, 0, 1), 0), (-1, -1, -0.2), (1, 1, 0.2), 0.05)
    with MapWriter.create(tmp_path / "m.uppm", "{}", {}) as writer:
        writer.checkpoint(checkpoint_of([floor], changed={1: blocks}))
    return PanopticMap.from_file(MapReader.open(tmp_path / "m.uppm"))


def test_a_map_without_anything_between_floor_and_ceiling_has_no_rooms(floor_only: PanopticMap) -> None:
    assert floor_only.rooms == {}
    scene = Scene(floor_only)
    body = scene.placed(floor_only.submap(1))
    assert body is not None
    assert body.room == 0


def test_a_map_too_large_for_a_plan_is_an_error_and_not_one_without_rooms(
    floor_only: PanopticMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(occupancy, "MAX_CELLS", 10)
    with pytest.raises(InputError, match="expected at most 10 cells"):
        Scene(floor_only).placed(floor_only.submap(1))
