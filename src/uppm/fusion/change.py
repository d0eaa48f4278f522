"""Change detection between two visits: what stayed, went, came or moved (docs/change-detection.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree
from skimage.color import rgb2lab

from uppm.core.types import Change, ChangeState, Frame, Mesh, Submap, SubmapKind, SubmapState
from uppm.fusion.seeing import Sightings, count_sightings
from uppm.fusion.tracking import CategoryPolicy

MAX_POINTS = 4000
"""Surface points looked at for one object."""
BESIDE, OFF = 1.5, 1.0
"""A point is on a surface where a vertex is this near (coarser voxels) and its plane that near (finer voxels)."""
MIN_POINTS, MIN_SHARE = 20, 0.05
"""Points, and share of an object's points, about which the other visit must say something."""
MIN_FREE = 2
"""Frames that must see through a point, and more than measure something there, for it to be free."""
FREE_SHARE = 0.3
"""Share of the points about which it says something that must be free for the object not to be there."""
SAME_SHARE = 0.3
"""Share of a new object's surface on an old one of a compatible category at which it is that one, seen again."""
MIN_LIKENESS = 0.35
"""Least likeness of an absent and a new object for the one to have moved there."""
COLOR_STEP = 25.0
"""CIELAB distance of two mean colours at which likeness falls to 1/e."""

Points = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """One submap's surface: vertices and unit normals (N, 3) with colours, in the frame of the new map."""

    submap: Submap
    points: Points
    normals: Points
    colors: npt.NDArray[np.uint8]
    tree: KDTree

    @classmethod
    def of(cls, submap: Submap, mesh: Mesh) -> Surface:
        points, normals = mesh.vertices.astype(np.float64), mesh.normals.astype(np.float64)
        return cls(submap=submap, points=points, normals=normals, colors=mesh.colors, tree=KDTree(points))

    @property
    def is_object(self) -> bool:
        return self.submap.kind is SubmapKind.OBJECT

    @property
    def category(self) -> int:
        return self.submap.descriptor.category.id if self.submap.descriptor else 0

    @property
    def center(self) -> Points:
        """(3,) of the bounds, metres."""
        return (self.points.min(axis=0) + self.points.max(axis=0)) / 2

    def sample(self) -> Points:
        return self.points[:: -(-len(self.points) // MAX_POINTS)]

    def holds(self, points: Points, voxel_size: float) -> Mask:
        """Which points (N, 3) of a surface with these voxels lie on this one."""
        reach = BESIDE * max(voxel_size, self.submap.voxel_size)
        distance, nearest = self.tree.query(points, distance_upper_bound=reach)
        found = np.isfinite(distance)
        away = points[found] - self.points[nearest[found]]
        off = np.abs((away * self.normals[nearest[found]]).sum(axis=1))
        found[found] = off <= OFF * min(voxel_size, self.submap.voxel_size)
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Match:
    """An object's points by what the other visit's map has there."""

    same: Mask
    """On a surface of a compatible category."""
    other: Mask
    """On another surface only."""
    best: Surface | None
    """The compatible object that most of them lie on."""


def surfaces(submaps: Iterable[Submap], mesh: Callable[[int], Mesh]) -> list[Surface]:
    """The believed submaps that have a surface; mesh: submap id -> its surface in the frame of the new map."""
    believed = [s for s in submaps if s.descriptor and s.state is not SubmapState.TENTATIVE]
    return [Surface.of(s, m) for s in believed if len((m := mesh(s.id)).vertices)]


def detect_changes(
    old: Sequence[Surface],
    new: Sequence[Surface],
    new_frames: Iterable[Frame],
    old_views: Callable[[Points], Iterable[Frame]],
    policy: CategoryPolicy,
) -> tuple[Change, ...]:
    """What became of each object of the old map, then what is new.

    Parameters
    ----------
    old, new : surfaces of both maps in the frame of the new one.
    new_frames : the second visit, as recorded.
    old_views : frames in which the first visit had points (N, 3) in view, recorded or rendered from its map; poses in
        the frame of the new map.
    policy : which categories may be one object's.
    """
    visit = _Comparison(old=old, new=new, policy=policy)
    visit.judge_old(count_sightings(new_frames, [s.sample() for s in old if s.is_object]))
    fresh = [s.sample() for s in visit.unmatched()]
    visit.judge_new(count_sightings(old_views(np.concatenate(fresh)), fresh) if fresh else [])
    return visit.changes()


@dataclass(kw_only=True, eq=False)
class _Comparison:
    old: Sequence[Surface]
    new: Sequence[Surface]
    policy: CategoryPolicy
    _old: dict[int, Change] = field(default_factory=dict)
    _new: dict[int, Change] = field(default_factory=dict)

    def judge_old(self, sightings: Sequence[Sightings]) -> None:
        """Persistent, absent or unobserved, by the new map's surfaces and the new frames."""
        for surface, seen in zip((s for s in self.old if s.is_object), sightings, strict=True):
            match = _match(surface, self.new, self.policy)
            free = ~match.same & (seen.through >= MIN_FREE) & (seen.through > seen.measured)
            counts = _counts(agree=match.same, free=free, replaced=match.other & ~free)
            state = _fate(counts)
            partner = match.best if state is ChangeState.PERSISTENT else None
            self._old[surface.submap.id] = _change(state, surface, partner, counts)

    def unmatched(self) -> list[Surface]:
        """New objects that are no old one seen again."""
        taken = {change.id_new for change in self._old.values()}
        return [s for s in self.new if s.is_object and s.submap.id not in taken and not self._seen_before(s)]

    def _seen_before(self, surface: Surface) -> bool:
        match = _match(surface, self.old, self.policy)
        return match.same.mean() >= SAME_SHARE

    def judge_new(self, sightings: Sequence[Sightings]) -> None:
        """Moved, where something like it is absent; new, where the old visit saw that nothing was there."""
        fresh = self.unmatched()
        absent = [s for s in self.old if s.is_object and self._old[s.submap.id].state is ChangeState.ABSENT]
        pairs = pair_moved(absent, fresh, self.policy)
        for surface, seen in zip(fresh, sightings, strict=True):
            match = _match(surface, self.old, self.policy)
            free = ~match.same & ~match.other & (seen.through >= MIN_FREE) & (seen.through > seen.measured)
            counts = _counts(agree=match.same, free=free, replaced=match.other)
            if surface.submap.id in pairs:
                before, likeness = pairs[surface.submap.id]
                evidence = {**self._old[before.submap.id].evidence, "likeness": round(likeness, 3)}
                self._old[before.submap.id] = _change(ChangeState.MOVED, before, surface, evidence)
            elif _fate(counts) is ChangeState.ABSENT:
                # Where it is now, the old visit saw that it was not.
                self._new[surface.submap.id] = _change(ChangeState.NEW, None, surface, counts)

    def changes(self) -> tuple[Change, ...]:
        return (*self._old.values(), *self._new.values())


def _match(surface: Surface, others: Sequence[Surface], policy: CategoryPolicy) -> _Match:
    points, size = surface.sample(), surface.submap.voxel_size
    low, high = points.min(axis=0), points.max(axis=0)
    same, other = np.zeros(len(points), dtype=np.bool_), np.zeros(len(points), dtype=np.bool_)
    best, most = None, 0
    for candidate in others:
        margin = BESIDE * max(size, candidate.submap.voxel_size)
        apart = (candidate.points.min(axis=0) > high + margin) | (candidate.points.max(axis=0) < low - margin)
        if apart.any():
            continue
        held = candidate.holds(points, size)
        if not _compatible(surface, candidate, policy):
            other |= held
            continue
        same |= held
        if candidate.is_object and held.sum() > most:
            best, most = candidate, held.sum()
    return _Match(same=same, other=other & ~same, best=best)


def _compatible(a: Surface, b: Surface, policy: CategoryPolicy) -> bool:
    return bool(np.isfinite(policy.least_overlap([a.category], [b.category], 0.0)[0, 0]))


def _counts(**masks: Mask) -> dict[str, float]:
    points = len(next(iter(masks.values())))
    return {"points": points, **{name: int(mask.sum()) for name, mask in masks.items()}}


def _fate(counts: Mapping[str, float]) -> ChangeState:
    """The state of an object in the other visit, by its points.

    What is replaced does not tell a thing that went from one that got another name: it counts as seen, not as gone.
    """
    if counts["agree"] + counts["free"] < max(MIN_POINTS, MIN_SHARE * counts["points"]):
        return ChangeState.UNOBSERVED
    if counts["agree"] >= counts["free"]:
        return ChangeState.PERSISTENT
    judged = counts["agree"] + counts["free"] + counts["replaced"]
    return ChangeState.ABSENT if counts["free"] >= FREE_SHARE * judged else ChangeState.UNOBSERVED


def pair_moved(
    absent: Sequence[Surface], fresh: Sequence[Surface], policy: CategoryPolicy
) -> dict[int, tuple[Surface, float]]:
    """New object's id -> the absent one that it was, with their likeness: the assignment of greatest likeness."""
    table = np.array([[likeness(a, b) if _compatible(a, b, policy) else 0.0 for b in fresh] for a in absent])
    table = np.where(table >= MIN_LIKENESS, table, 0.0).reshape(len(absent), len(fresh))
    rows, columns = linear_sum_assignment(table, maximize=True)
    pairs = ((int(r), int(c)) for r, c in zip(rows, columns, strict=True))
    return {fresh[c].submap.id: (absent[r], float(table[r, c])) for r, c in pairs if table[r, c] > 0}


def likeness(a: Surface, b: Surface) -> float:
    """0 to 1: how far two surfaces agree in their spreads along their principal axes, and in mean colour."""
    spread_a, spread_b = (np.sqrt(np.linalg.eigvalsh(np.cov(s.points.T)).clip(1e-8)) for s in (a, b))
    shape = np.prod(np.minimum(spread_a, spread_b) / np.maximum(spread_a, spread_b)) ** (1 / 3)
    mean_a, mean_b = (rgb2lab(s.colors.mean(axis=0) / 255.0) for s in (a, b))
    return float(shape * np.exp(-np.linalg.norm(mean_a - mean_b) / COLOR_STEP))


def _change(state: ChangeState, old: Surface | None, new: Surface | None, evidence: Mapping[str, float]) -> Change:
    first = old or new
    assert first
    assert first.submap.descriptor
    described = first.submap.descriptor
    return Change(
        state=state,
        id_old=old.submap.id if old else None,
        id_new=new.submap.id if new else None,
        category=described.category.name,
        label=described.labels[0].text if described.labels else described.category.name,
        center_old=old.center if old else None,
        center_new=new.center if new else None,
        evidence=evidence,
    )
