"""Relations on constructed boxes; lengths in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uppm.map import relations
from uppm.map.relations import RELATIONS, Body


def body(
    id_: int,
    low: Sequence[float],
    high: Sequence[float],
    *,
    wall: bool = False,
    barrier: bool = False,
    room: int = 1,
    seen_from: Sequence[float] | None = None,
) -> Body:
    """The six faces of a box, a point every 4 cm or so; its edges above are part of its upper side."""
    low_, high_ = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
    steps = [np.linspace(a, b, max(3, round((b - a) / 0.04) + 1)) for a, b in zip(low_, high_, strict=True)]
    points = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    surface = (np.isclose(points, low_) | np.isclose(points, high_)).any(axis=1)
    points = points[surface]
    level = (points[:, 2] == high_[2]).astype(np.float64) - (points[:, 2] == low_[2])
    level[points[:, 2] == high_[2]] = 1.0
    normals = np.column_stack([1 - abs(level), np.zeros_like(level), level])
    viewer = None if seen_from is None else np.array(seen_from, dtype=np.float64)
    return Body(
        id=id_, points=points, normals=normals, is_wall=wall, is_barrier=wall or barrier, room=room, seen_from=viewer
    )


def joined(id_: int, *parts: Body, seen_from: Sequence[float]) -> Body:
    """One body of several."""
    points, normals = (np.concatenate([getattr(p, name) for p in parts]) for name in ("points", "normals"))
    return Body(id=id_, points=points, normals=normals, room=1, seen_from=np.array(seen_from, dtype=np.float64))


def table_of(x: float = 0.0, y: float = 0.0) -> Body:
    """A board on four legs, 1.2 m by 0.8 m and 0.75 m high."""
    board = body(1, (x, y, 0.70), (x + 1.2, y + 0.8, 0.75))
    legs = [body(1, (x + i, y + j, 0), (x + i + 0.05, y + j + 0.05, 0.68)) for i in (0, 1.15) for j in (0, 0.75)]
    return joined(1, board, *legs, seen_from=(0.6, -3.0, 1.5))


TABLE = table_of()
CUP = body(2, (0.5, 0.3, 0.76), (0.58, 0.38, 0.86))
BASKET = body(3, (0.4, 0.2, 0.0), (0.8, 0.6, 0.4))
PICTURE = body(4, (0.2, 0.76, 1.3), (0.9, 0.80, 1.8))
CHAIR = body(5, (1.4, 0.2, 0.0), (1.9, 0.7, 0.9))
WALL = body(6, (-2, 0.82, 0), (3, 0.90, 2.5), wall=True)
APPLE = body(7, (0.5, 0.3, 0.1), (0.57, 0.37, 0.17))
RUG = body(10, (-0.5, -0.5, -0.02), (1.5, 1.2, 0.0))
PLANT = body(8, (4.0, 0.2, 0.0), (4.3, 0.5, 0.6))
FLOOR = body(11, (-3, -3, -0.04), (6, 3, -0.02))
CABINETS = [body(12 + n, (x, -2, 0.0), (x + 0.6, -1.4, 0.85)) for n, x in enumerate((0.0, 0.6))]
BOOK = body(14, (0.62, 0.3, 0.75), (0.82, 0.5, 0.78))
POT = body(15, (0.86, 0.3, 0.75), (1.0, 0.44, 1.0))
SHELVES = joined(
    16,
    *[body(16, (3, -2, z), (3.9, -1.6, z + 0.03)) for z in (0.1, 0.5, 0.9, 1.3)],
    *[body(16, (x, -2, 0), (x + 0.03, -1.6, 1.33)) for x in (2.97, 3.9)],
    seen_from=(3.4, 2, 1.5),
)
VASE = body(17, (3.3, -1.9, 0.54), (3.5, -1.7, 0.8))


def holds(name: str, a: Body, *others: Body, viewer: Sequence[float] | None = None) -> bool:
    return RELATIONS[name](a, others, None if viewer is None else np.array(viewer))


EVERYTHING = [TABLE, CUP, BASKET, PICTURE, CHAIR, WALL, APPLE, RUG, PLANT, FLOOR, *CABINETS, BOOK, POT, SHELVES, VASE]


@pytest.mark.parametrize(
    ("name", "a", "others", "answer"),
    [
        ("on", CUP, [TABLE], True),
        ("on", CABINETS[0], [CABINETS[1]], False),  # Both stand on the floor.
        ("on", CABINETS[1], [CABINETS[0]], False),
        ("on", BOOK, [TABLE], True),
        ("on", POT, [TABLE], True),
        ("on", POT, [BOOK], False),  # Its lowest is as high as the book, but beside it.
        ("on", BOOK, [POT], False),
        ("on", RUG, [FLOOR], True),
        ("on", FLOOR, [RUG], False),
        ("on", TABLE, [FLOOR], True),
        ("on", WALL, [FLOOR], False),
        ("on", VASE, [SHELVES], True),
        ("on", SHELVES, [VASE], False),
        ("on", body(9, (0.2, 0.2, 0.75), (0.5, 0.3, 2.0), barrier=True), [TABLE], False),
        ("on", TABLE, [CUP], False),
        ("on", BASKET, [TABLE], False),
        ("on", PICTURE, [TABLE], False),
        ("on", PICTURE, [WALL], True),
        ("on", CHAIR, [TABLE], False),
        ("under", BASKET, [TABLE], True),
        ("under", TABLE, [CUP], True),
        ("under", CUP, [TABLE], False),
        ("under", CHAIR, [TABLE], False),
        ("above", PICTURE, [TABLE], True),
        ("above", CUP, [TABLE], False),
        ("on", TABLE, [RUG], True),
        ("on", RUG, [TABLE], False),
        ("under", RUG, [TABLE], True),
        ("on", CHAIR, [RUG], False),
        ("above", PICTURE, [CHAIR], False),
        ("below", TABLE, [PICTURE], True),
        ("below", PICTURE, [TABLE], False),
        ("in", APPLE, [BASKET], True),
        ("in", BASKET, [APPLE], False),
        ("in", CUP, [BASKET], False),
        ("next to", CHAIR, [TABLE], True),
        ("next to", CUP, [TABLE], False),
        ("next to", PLANT, [TABLE], False),
        ("next to", PICTURE, [CHAIR], False),
        ("between", CHAIR, [TABLE, PLANT], True),
        ("between", TABLE, [CHAIR, PLANT], False),
        ("between", body(9, (2.0, 2.5, 0), (2.3, 2.8, 0.5)), [TABLE, PLANT], False),
        ("against", PICTURE, [WALL], True),
        ("against", TABLE, [WALL], True),
        ("against", body(9, (0, 0, 0), (0.3, 0.3, 1)), [WALL], False),
        ("against", PICTURE, [CHAIR], False),
        ("in the same room as", CUP, [CHAIR], True),
        ("in the same room as", CUP, [body(9, (0, 0, 0), (1, 1, 1), room=2)], False),
        ("in the same room as", CUP, [body(9, (0, 0, 0), (1, 1, 1), room=0)], False),
    ],
)
def test_relation(name: str, a: Body, others: list[Body], answer: bool) -> None:
    assert holds(name, a, *others) is answer


def test_support_holds_one_way_only() -> None:
    """Of neighbours that begin at one height neither carries the other, and nothing carries what carries it."""
    both = [
        (a.id, b.id) for a in EVERYTHING for b in EVERYTHING if a is not b and holds("on", a, b) and holds("on", b, a)
    ]
    assert both == []


boxes = st.tuples(*[st.floats(-0.3, 0.3), st.floats(0.03, 0.5)] * 3)


@given(boxes, boxes)
@settings(max_examples=150, deadline=None)
def test_support_of_any_two_boxes_holds_one_way_only(one: tuple[float, ...], two: tuple[float, ...]) -> None:
    a, b = (body(n, at[::2], np.add(at[::2], at[1::2]).tolist()) for n, at in enumerate((one, two), start=1))
    assert not (holds("on", a, b) and holds("on", b, a))


def test_sides_are_those_of_the_viewer() -> None:
    """By default of the camera that saw the other thing first: south of the table here, looking north."""
    assert holds("right of", CHAIR, TABLE)
    assert not holds("left of", CHAIR, TABLE)
    assert holds("left of", CHAIR, TABLE, viewer=(0.6, 4.0, 1.5))
    assert holds("behind", CHAIR, TABLE, viewer=(-3.0, 0.4, 1.5))
    assert holds("in front of", CHAIR, TABLE, viewer=(6.0, 0.4, 1.5))
    assert not holds("right of", PLANT, TABLE)  # More than 1.5 m away.
    assert not holds("right of", TABLE, CHAIR)  # Nobody is known to have seen the chair.


def test_a_gap_wider_than_the_tolerance_is_no_support() -> None:
    lifted = body(2, (0.5, 0.3, 0.75 + 1.5 * relations.TOUCH), (0.58, 0.38, 0.95))
    assert not holds("on", lifted, TABLE)
    assert holds("above", lifted, TABLE)


def test_what_is_next_to_something_depends_on_size() -> None:
    small = body(9, (1.2 + 0.45, 0.3, 0.7), (1.2 + 0.5, 0.35, 0.75))
    large = body(9, (1.2 + 0.45, 0.3, 0.0), (1.2 + 1.25, 0.8, 0.8))
    assert not holds("next to", small, TABLE)
    assert holds("next to", large, TABLE)


def test_other_rooms_are_not_near() -> None:
    beyond = body(9, (1.4, 0.2, 0.0), (1.9, 0.7, 0.9), room=2)
    assert not holds("next to", beyond, TABLE)
    assert not holds("right of", beyond, TABLE)


def test_distances_are_between_surfaces() -> None:
    assert relations.gap(TABLE, CHAIR) == pytest.approx(0.2, abs=1e-3)
    assert relations.boxes_apart(TABLE, CHAIR) == pytest.approx(0.2)
    assert relations.boxes_apart(TABLE, CUP) == pytest.approx(0.01)


def test_a_door_is_in_both_of_its_rooms() -> None:
    cells = np.stack(np.meshgrid(*[np.linspace(0, 0.3, 5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    up = np.tile([0.0, 0.0, 1.0], (len(cells), 1))
    bin_ = Body(id=1, points=cells, normals=up, room=1)
    door = Body(id=2, points=cells + np.array([0.4, 0, 0]), normals=up, room=2)
    assert not RELATIONS["next to"](bin_, [door], None)
    assert RELATIONS["next to"](bin_, [replace(door, is_barrier=True)], None)
