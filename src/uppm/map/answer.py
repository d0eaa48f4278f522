"""Answers to questions: which submaps are of a kind, have the colour, stand in the relation (docs/query.md)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.categories import plain_name
from uppm.core.types import Submap
from uppm.map.colors import is_colored
from uppm.map.panoptic_map import QueryResult, submap_dict
from uppm.map.query import Answer
from uppm.map.question import Question, Thing
from uppm.map.relations import RELATIONS, Body, gap
from uppm.map.scene import ROOM_NAMES, Scene

KIND_MARGIN = 2.0
"""Log-odds behind the best answer up to which things are of the kind asked for, where nothing is called so."""
SHORTEST_PART = 4
"""Letters that a noun must have to count at the end of a longer word: `armchair` is a chair, `carpet` no pet."""
NEEDS_NO_ROOM = ("on", "under", "above", "below", "in", "against")
"""Relations that no wall comes between."""

NO_ROOMS_YET = "rooms are told apart when mapping is done: ask again then"

Search = Callable[[str], Sequence[Answer]]
"""Noun -> all submaps, the most probable first."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """One submap that answers a question."""

    submap: Submap
    label: str
    """The submap's label that matched the noun best, or its commonest."""
    probability: float
    """That the submap is what the noun says; 1 where any thing was asked for."""
    reasons: tuple[str, ...] = ()
    """What else speaks for it: colour, relation, size."""

    def because(self, reason: str) -> Found:
        """With one more reason."""
        return replace(self, reasons=(*self.reasons, reason))

    def __str__(self) -> str:
        return f"{self.label} #{self.submap.id}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Reply:
    """What a map answers to a question, or to a plain phrase."""

    text: str
    """As asked."""
    understood: str | None = None
    """The question in the grammar's own words; None: searched as a plain phrase."""
    results: tuple[Found, ...] = ()
    """Of a question: the answers, at most as many as were asked for."""
    count: int | None = None
    """Of a question: how many answers there are in all."""
    note: str = ""
    """Why nothing answers, or that the sentence was not understood."""
    counting: bool = False
    """The number is what was asked for."""
    plain: QueryResult | None = None
    """Of a plain phrase: what `PanopticMap.query` answers."""

    @property
    def found(self) -> bool:
        """Something in the map answers."""
        return self.plain.found if self.plain else bool(self.results)

    def to_dict(self) -> dict[str, Any]:
        """What `uppm query --json` prints."""
        note = {"note": self.note} if self.note else {}
        if self.plain:
            return self.plain.to_dict() | note
        results = [
            {"id": f.submap.id, "label": f.label, "probability": round(f.probability, 4), "reasons": list(f.reasons)}
            | {key: value for key, value in submap_dict(f.submap).items() if key in ("category", "center", "extent")}
            for f in self.results
        ]
        return {
            "query": self.text,
            "understood": self.understood,
            "found": self.found,
            "count": self.count,
            "results": results,
        } | note


class Answerer:
    """Answers questions on one map.

    Parameters
    ----------
    search : the plain search, for nouns.
    objects : what "thing" stands for.
    scene : the map's geometry.
    normal : brings a noun into the form of the labels.
    viewpoint : (3,) frame upright; None: of the camera that saw the other thing first.
    """

    def __init__(
        self,
        search: Search,
        objects: Sequence[Submap],
        scene: Scene,
        normal: Callable[[str], str],
        viewpoint: npt.NDArray[np.float64] | None,
    ) -> None:
        self._search, self._objects, self._scene, self._viewpoint = search, objects, scene, viewpoint
        self._normal = normal

    def answer(self, question: Question) -> tuple[list[Found], str]:
        """What answers, and where nothing does, why."""
        return self._find(question.thing)

    def _find(self, thing: Thing) -> tuple[list[Found], str]:
        found = self._of_kind(thing.noun)
        if not found:
            return [], f"nothing here matches {thing.noun!r}"
        if thing.colors:
            colored = [f for f in found if is_colored(self._scene.shares(f.submap), thing.colors)]
            if not colored:
                return [], f"{_names(found)}: none is {' and '.join(thing.colors)}, but {self._colors(found)}"
            found = [f.because(_shares(self._scene.shares(f.submap), thing.colors)) for f in colored]
        if thing.relation:
            found, why = self._related(found, thing)
            if not found:
                return [], why
        return self._extreme(found, thing) if thing.superlative else (found, "")

    def _of_kind(self, noun: str | None) -> list[Found]:
        if noun is None:
            return [
                Found(submap=s, label=s.descriptor.labels[0].text, probability=1.0)
                for s in self._objects
                if s.descriptor and s.descriptor.labels
            ]
        answers = of_kind(self._normal(noun), self._search(noun))
        return [Found(submap=a.submap, label=a.label, probability=a.probability) for a in answers]

    def _colors(self, found: Sequence[Found]) -> str:
        names = dict.fromkeys(name for f in found for name in list(self._scene.shares(f.submap))[:1])
        return ", ".join(names) or "without colour"

    def _related(self, found: list[Found], thing: Thing) -> tuple[list[Found], str]:
        relation = str(thing.relation)
        kind = ROOM_NAMES.get(thing.others[0].noun or "") if relation == "in" else None
        if not self._scene.tells_rooms and (kind or relation == "in the same room as"):
            return [], NO_ROOMS_YET
        if kind:
            return self._in_room(found, kind)
        anchors: list[list[Found]] = []
        for other in thing.others:
            some, why = self._find(other)
            if not some:
                return [], why
            anchors.append(some)
        related = [f.because(reason) for f in found if (reason := self._holds(relation, f, anchors))]
        return related, f"{_names(found)}: none is {relation} {' and '.join(map(_names, anchors))}"

    def _holds(self, relation: str, found: Found, anchors: Sequence[Sequence[Found]]) -> str:
        """The reason why a relation holds to one of each list of anchors; empty where it does not."""
        body = self._body(found.submap, relation)
        if body is None:
            return ""
        for others in product(*anchors):
            ids = {found.submap.id, *(other.submap.id for other in others)}
            bodies = [b for other in others if (b := self._body(other.submap, relation))]
            apart = len(ids) == len(others) + 1 and len(bodies) == len(others)
            if apart and RELATIONS[relation](body, bodies, self._viewpoint):
                return f"{relation} {' and '.join(map(str, others))}"
        return ""

    def _in_room(self, found: list[Found], kind: str) -> tuple[list[Found], str]:
        names = self._scene.room_names
        if kind not in names.values():
            return [], f"no room here is a {kind} by what is in it"
        placed = [(f, self._scene.placed(f.submap)) for f in found]
        inside = [f.because(f"in the {kind}") for f, body in placed if body and names.get(body.room) == kind]
        return inside, f"{_names(found)}: none is in the {kind}"

    def _body(self, submap: Submap, relation: str) -> Body | None:
        return self._scene.body(submap) if relation in NEEDS_NO_ROOM else self._scene.placed(submap)

    def _extreme(self, found: list[Found], thing: Thing) -> tuple[list[Found], str]:
        measure, unit, sign = self._measure(thing)
        if measure is None:
            return [], unit
        values = [(f, measure(f.submap)) for f in found]
        known = [(f, value) for f, value in values if value is not None]
        if not known:
            return [], f"{_names(found)}: no surface to measure"
        best, value = max(known, key=lambda item: (sign * item[1], -item[0].submap.id))
        return [best.because(f"{thing.superlative} of {len(known)}: {value:.2f} {unit}")], ""

    def _measure(self, thing: Thing) -> tuple[Callable[[Submap], float | None] | None, str, int]:
        """What a superlative compares, its unit, and whether more or less of it is meant."""
        if thing.superlative in ("nearest", "farthest"):
            sign = 1 if thing.superlative == "farthest" else -1
            measure, what = self._distance(thing)
            return measure, what, sign
        sizes = self._scene.size
        measures: dict[str, tuple[Callable[[Submap], float | None], str, int]] = {
            "largest": (lambda s: float(np.prod(sizes(s))), "m3", 1),
            "smallest": (lambda s: float(np.prod(sizes(s))), "m3", -1),
            "tallest": (lambda s: float(sizes(s)[2]), "m", 1),
            "shortest": (lambda s: float(sizes(s)[2]), "m", -1),
            "longest": (lambda s: float(sizes(s)[0]), "m", 1),
            "highest": (lambda s: self._top(s), "m", 1),
            "lowest": (lambda s: self._top(s), "m", -1),
        }
        return measures[str(thing.superlative)]

    def _top(self, submap: Submap) -> float | None:
        body = self._scene.body(submap)
        return float(body.high[2]) if body else None

    def _distance(self, thing: Thing) -> tuple[Callable[[Submap], float | None] | None, str]:
        """Distance to what is named, else to where one looks from; without either None, and why."""
        if thing.others and not thing.relation:
            anchors, why = self._find(thing.others[0])
            if not anchors:
                return None, why
            bodies = [b for b in (self._scene.body(f.submap) for f in anchors) if b]
            return lambda s: _gap(self._scene.body(s), bodies), f"m to {_names(anchors)}"
        point = self._viewpoint if self._viewpoint is not None else self._scene.viewpoint()
        if point is None:
            return None, f"{thing.superlative} to what? The map has no camera pose to measure from"
        whence = "the viewpoint" if self._viewpoint is not None else "the last camera"
        return lambda s: self._to_point(s, point), f"m from {whence}"

    def _to_point(self, submap: Submap, point: npt.NDArray[np.float64]) -> float | None:
        body = self._scene.body(submap)
        return float(body.tree.query(point)[0]) if body else None


def of_kind(noun: str, answers: Sequence[Answer]) -> list[Answer]:
    """The answers that are of a kind: those that are called so, else those found that are about as good as the best.

    Called so: by the matched label's head (`office chair`), the category, or its supercategory (`furniture`); a cactus
    is a potted plant, and so a plant, however unlike the two words are.
    """
    found = [answer for answer in answers if answer.found]
    called = [answer for answer in answers if _is_called(noun, answer)]
    return called or [answer for answer in found if answer.score >= found[0].score - KIND_MARGIN]


def _is_called(noun: str, answer: Answer) -> bool:
    category = answer.submap.descriptor.category if answer.submap.descriptor else None
    names = [answer.label.split(" of ")[0]]
    if category:
        names += [plain_name(category.name), category.supercategory]
    whole = answer.label == noun
    return whole or any(name == noun or name.endswith(f" {noun}") or _ends_with(name, noun) for name in names)


def _ends_with(name: str, noun: str) -> bool:
    return len(noun) >= SHORTEST_PART and " " not in noun and name.endswith(noun)


def _gap(body: Body | None, others: Sequence[Body]) -> float | None:
    """Metres to the nearest of the others that is not the body itself."""
    gaps = [gap(body, other) for other in others if other.id != body.id] if body else []
    return min(gaps) if gaps else None


def _shares(shares: Mapping[str, float], colors: Sequence[str]) -> str:
    return ", ".join(f"{color} {shares.get(color, 0.0):.0%}" for color in colors)


def _names(found: Sequence[Found]) -> str:
    shown = ", ".join(str(f) for f in found[:3])
    return shown + (f" and {len(found) - 3} more" if len(found) > 3 else "")
