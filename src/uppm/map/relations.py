"""Where things stand to each other, from their surfaces alone (docs/query.md lists every tolerance).

All of it happens in frame upright: the map's, turned so that z is up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation
from scipy.spatial import KDTree

Points = npt.NDArray[np.float64]

OUTLIERS = 1.0
"""Per cent of a surface's points that may lie beyond its box on each side: scraps of a neighbour."""
TOUCH = 0.06
"""Metres between what rests on something and that surface: two voxels of a chair, and the noise of depth."""
MARGIN = 0.10
"""Metres that a footprint is widened by: what lies under a thing is hidden by it, and seen only around it."""
SUPPORT, PATCH = 0.15, 0.05
"""Share of the area that both cover, as patches of so many metres, on which a thing must touch what carries it."""
FACING_UP = 0.7
"""Least upward part of the normal of a surface that can carry something: at most 45 degrees from level."""
CARRIED = 0.5
"""Share of a thing's footprint that must be over what carries it."""
COVER_POINTS = 3
"""Points of a surface that must be over a thing for it to be under that."""
INSIDE, SLACK = 0.7, 0.05
"""Share of a thing's box that must be in another's, widened by so many metres, to be in it."""
NEXT_TO, NEXT_TO_SIZE, NEXT_TO_MOST = 0.30, 0.30, 0.75
"""Gap in metres; what the smaller thing's longest side adds to it, as a share; and the widest gap of all."""
LEVEL = 0.25
"""Metres of height that may lie between things that are next to each other."""
BETWEEN_SHARE, BETWEEN_REACH, BETWEEN_ASIDE = 0.15, 0.25, 0.30
"""How near to either end, as a share of the line between the two; how far aside: that share of it, or metres."""
BESIDE = 1.5
"""Metres of gap up to which one thing is left of, right of, in front of or behind another."""
AGAINST, AGAINST_SIZE = 0.15, 0.15
"""Gap to a wall in metres, and what the thing's shorter horizontal side adds to it, as a share."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Body:
    """The surface of one thing, frame upright."""

    id: int
    points: Points
    """(N, 3), metres, N > 0."""
    normals: Points
    """(N, 3) unit normals of the surface, outwards."""
    is_wall: bool = False
    is_barrier: bool = False
    """A wall, door or window: it stands between rooms, and is in none of them alone."""
    room: int = 0
    """0: none known."""
    seen_from: Points | None = None
    """(3,): the camera that saw it first."""

    @cached_property
    def low(self) -> Points:
        """(3,) lowest corner, metres, but for outliers."""
        return np.percentile(self.points, OUTLIERS, axis=0)

    @cached_property
    def high(self) -> Points:
        """(3,) highest corner, metres, but for outliers."""
        return np.percentile(self.points, 100 - OUTLIERS, axis=0)

    @property
    def center(self) -> Points:
        """(3,) middle of the box, metres."""
        return (self.low + self.high) / 2

    @property
    def size(self) -> Points:
        """(3,) along x, y and up, metres."""
        return self.high - self.low

    @cached_property
    def upper(self) -> Points:
        """(M, 3) points of its surface that face up, and so can carry something."""
        return self.points[self.normals[:, 2] >= FACING_UP]

    @cached_property
    def footprint(self) -> Points:
        """(K, 2) middles of the patches that it covers, as seen from above."""
        return (np.unique(np.floor(self.points[:, :2] / PATCH), axis=0) + 0.5) * PATCH

    @cached_property
    def tree(self) -> KDTree:
        """For distances to it."""
        return KDTree(self.points)


def gap(a: Body, b: Body) -> float:
    """Metres between two surfaces."""
    few, many = (a, b) if len(a.points) < len(b.points) else (b, a)
    return float(many.tree.query(few.points)[0].min())


def boxes_apart(a: Body, b: Body) -> float:
    """Metres between two boxes, 0 where they overlap: never more than `gap`."""
    return float(np.linalg.norm(np.maximum(np.maximum(a.low - b.high, b.low - a.high), 0)))


def on(a: Body, b: Body) -> bool:
    """a rests on b: b's upper surface is as high as a's lowest, within `TOUCH`, over a good part of what both cover.

    Never both ways: of two that begin at one height the one whose middle is higher rests on the other, a table on its
    rug. On a wall: against it, off the floor. Walls, doors and windows rest on nothing: the building carries them.
    """
    if b.is_wall:
        return bool(against(a, b) and a.low[2] > b.low[2] + MARGIN)
    if a.is_barrier or not _is_higher(a, b) or not _carries(b, a):
        return False
    low = np.floor((np.maximum(a.low, b.low)[:2] - 2 * MARGIN) / PATCH)
    shape = np.ceil((np.minimum(a.high, b.high)[:2] + 2 * MARGIN) / PATCH - low).astype(int)
    if (shape <= 0).any():
        return False
    around = _widened(_plan(a.points, low, shape))
    touching = _plan(b.upper[np.abs(b.upper[:, 2] - a.low[2]) <= TOUCH], low, shape) & around
    shared = _widened(_plan(b.points, low, shape)) & around
    return bool(touching.sum() >= SUPPORT * max(shared.sum(), 1))


def under(a: Body, b: Body) -> bool:
    """a is below a surface of b that covers its middle, whether it touches it or not."""
    return below(a, b) or (_covered(a, b) and not on(a, b))


def above(a: Body, b: Body) -> bool:
    """a is higher than b and over it, but does not rest on it."""
    return bool(a.low[2] >= b.high[2] - TOUCH and _over(a, b) and not on(a, b))


def below(a: Body, b: Body) -> bool:
    """b is above a, or rests on it."""
    return above(b, a) or on(b, a)


def inside(a: Body, b: Body) -> bool:
    """a's box is in b's for the most part, and a is the smaller one."""
    low, high = np.maximum(a.low, b.low - SLACK), np.minimum(a.high, b.high + SLACK)
    shared = np.prod(np.maximum(high - low, 0) / np.maximum(a.size, 1e-3))
    return bool(shared >= INSIDE and np.prod(a.size) < np.prod(b.size))


def next_to(a: Body, b: Body) -> bool:
    """a and b are close for their size, at about one height, in one room, and neither on nor in the other."""
    smaller = min(float(a.size.max()), float(b.size.max()))
    most = min(NEXT_TO + NEXT_TO_SIZE * smaller, NEXT_TO_MOST)
    level = max(a.low[2], b.low[2]) - min(a.high[2], b.high[2]) <= LEVEL
    if not level or boxes_apart(a, b) > most or not same_room(a, b, unknown=True) or gap(a, b) > most:
        return False
    return not (below(a, b) or below(b, a) or inside(a, b) or inside(b, a))


def between(a: Body, b: Body, c: Body) -> bool:
    """a's middle is near the line from b's to c's, and not at its ends; as seen from above."""
    line, own = (c.center - b.center)[:2], (a.center - b.center)[:2]
    length = float(np.linalg.norm(line))
    if length < 1e-6:
        return False
    share = float(own @ line) / length**2
    aside = abs(float(line[0] * own[1] - line[1] * own[0])) / length
    reach = max(BETWEEN_REACH * length, BETWEEN_ASIDE)
    return BETWEEN_SHARE <= share <= 1 - BETWEEN_SHARE and aside <= reach and same_room(a, b, unknown=True)


def left_of(a: Body, b: Body, viewer: Points) -> bool:
    """Left of b for somebody at `viewer` (3,) who looks at b: to that side rather than nearer or farther."""
    return _sideways(a, b, viewer) == "left"


def right_of(a: Body, b: Body, viewer: Points) -> bool:
    """Right of b for somebody at `viewer` who looks at b."""
    return _sideways(a, b, viewer) == "right"


def in_front_of(a: Body, b: Body, viewer: Points) -> bool:
    """Nearer to the viewer than b, rather than aside."""
    return _sideways(a, b, viewer) == "front"


def behind(a: Body, b: Body, viewer: Points) -> bool:
    """Farther from the viewer than b, rather than aside."""
    return _sideways(a, b, viewer) == "behind"


def against(a: Body, wall: Body) -> bool:
    """a stands or hangs at a wall: the gap is small for its depth."""
    most = AGAINST + AGAINST_SIZE * float(a.size[:2].min())
    return wall.is_wall and a.id != wall.id and boxes_apart(a, wall) <= most and gap(a, wall) <= most


def same_room(a: Body, b: Body, *, unknown: bool = False) -> bool:
    """Both are in one room; `unknown`: what to say where the room of either is not known, or it bounds
    one: a door frame is in two."""
    if unknown and (a.is_barrier or b.is_barrier):
        return True
    return a.room == b.room if a.room and b.room else unknown


def _within_footprint(b: Body, a: Body, margin: float) -> Points:
    """Points of b within a's horizontal box, widened."""
    xy = b.points[:, :2]
    return b.points[((xy >= a.low[:2] - margin) & (xy <= a.high[:2] + margin)).all(axis=1)]


def _is_higher(a: Body, b: Body) -> bool:
    """a begins higher than b, or, where they begin within `TOUCH`, its middle is higher: never both ways."""
    rise = float(a.low[2] - b.low[2])
    return bool(a.center[2] > b.center[2]) if abs(rise) <= TOUCH else rise > 0


def _carries(b: Body, a: Body) -> bool:
    """Most of a's footprint is over b's box, or b's middle is under a: a rug's under a table."""
    over = ((a.footprint >= b.low[:2]) & (a.footprint <= b.high[:2])).all(axis=1)
    return bool(over.mean() >= CARRIED or (np.abs(a.footprint - b.center[:2]) <= PATCH).all(axis=1).any())


def _plan(points: Points, low: Points, shape: npt.NDArray[np.int_]) -> npt.NDArray[np.bool_]:
    """Which patches of a plan of this shape, which begins at the patch `low` (2,), have points over them."""
    at = np.floor(points[:, :2] / PATCH).astype(int) - low.astype(int)
    at = at[((at >= 0) & (at < shape)).all(axis=1)]
    plan = np.zeros(shape, dtype=bool)
    plan[at[:, 0], at[:, 1]] = True
    return plan


def _widened(plan: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """With the patches within `MARGIN`."""
    side = 1 + 2 * round(MARGIN / PATCH)
    return np.asarray(binary_dilation(plan, np.ones((side, side), dtype=bool)), dtype=bool)


def _over(a: Body, b: Body) -> bool:
    """The middle of either is over or under the other's footprint, widened."""
    pairs = ((a, b), (b, a))
    return any(bool(((p.center >= q.low - MARGIN) & (p.center <= q.high + MARGIN))[:2].all()) for p, q in pairs)


def _covered(a: Body, b: Body) -> bool:
    """b has a surface over a's middle, higher than most of a, and a stands lower than b's top."""
    over = _within_footprint(b, a, MARGIN)
    near = over[np.linalg.norm((over - a.center)[:, :2], axis=1) <= max(float(a.size[:2].max()) / 2, MARGIN)]
    high = (near[:, 2] >= a.high[2] - TOUCH).sum()
    return bool(high >= COVER_POINTS and a.high[2] < b.high[2] + TOUCH and _over(a, b) and a.center[2] < b.center[2])


def _sideways(a: Body, b: Body, viewer: Points) -> str:
    """Which side of b a is on for the viewer: left, right, front or behind; empty where it is none or far off."""
    forward = (b.center - viewer)[:2]
    distance = float(np.linalg.norm(forward))
    if distance < 1e-6 or boxes_apart(a, b) > BESIDE or not same_room(a, b, unknown=True):
        return ""
    forward = forward / distance
    right = np.array([forward[1], -forward[0]])
    offset = (a.center - b.center)[:2]
    aside, ahead = float(offset @ right), float(offset @ forward)
    if max(abs(aside), abs(ahead)) < TOUCH or on(a, b) or on(b, a):
        return ""
    if abs(aside) >= abs(ahead):
        return "right" if aside > 0 else "left"
    return "behind" if ahead > 0 else "front"


def _viewed(relation: Callable[[Body, Body, Points], bool]) -> Callable[[Body, Sequence[Body], Points | None], bool]:
    def holds(a: Body, others: Sequence[Body], viewer: Points | None) -> bool:
        seen_from = others[0].seen_from if viewer is None else viewer
        return seen_from is not None and relation(a, others[0], seen_from)

    return holds


def _pair(relation: Callable[[Body, Body], bool]) -> Callable[[Body, Sequence[Body], Points | None], bool]:
    return lambda a, others, viewer: relation(a, others[0])


RELATIONS: Mapping[str, Callable[[Body, Sequence[Body], Points | None], bool]] = {
    "on": _pair(on),
    "under": _pair(under),
    "above": _pair(above),
    "below": _pair(below),
    "in": _pair(inside),
    "next to": _pair(next_to),
    "between": lambda a, others, viewer: between(a, others[0], others[1]),
    "left of": _viewed(left_of),
    "right of": _viewed(right_of),
    "in front of": _viewed(in_front_of),
    "behind": _viewed(behind),
    "against": _pair(against),
    "in the same room as": _pair(same_room),
}
"""Name -> whether it holds of a thing, those it is related to (two for `between`), and where one looks from."""
