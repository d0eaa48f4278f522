"""Whether every name of a thing finds it: first, or among the first n of n of a kind."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from uppm.evaluation.ground_truth import SurfaceTruth
from uppm.evaluation.instances import MIN_PIXELS
from uppm.map.panoptic_map import PanopticMap
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval.category import PrototypeRetriever
from uppm.perception.simulated.names import name_table


@dataclass(frozen=True, kw_only=True)
class Asked:
    """One name, and one thing that is called so."""

    name: str
    thing: int
    """Instance."""
    kind: int
    """Things of the kind in the map: of the same unified category, or of that of another thing of this name."""
    place: int
    """Of the thing among the answers, from 1, found or not."""
    known: bool
    """The map has the thing for what it is: one of its submaps is of the kind's categories."""
    called: int
    """Submaps that the map has for one of the kind: its things, duplicates of them, and what is wrongly called so."""

    @property
    def right(self) -> bool:
        """Among the first n, of n of its kind."""
        return self.place <= self.kind

    @property
    def as_the_map_has_it(self) -> bool:
        """Among the first n, of n that the map has for one of the kind: what a query that knows no truth can do."""
        return self.place <= max(self.kind, self.called)


@dataclass(frozen=True, kw_only=True)
class SynonymMetrics:
    """Shares from 0 to 1, of the things that the map has, by whatever name."""

    unique: float
    """Of the names of things that are the only one of their kind: it is the first."""
    unique_things: float
    """Of these things: every name finds it first."""
    of_a_kind: float
    """Of the names of things of which there are n: it is among the first n."""
    known_unique: float
    """As `unique`, of the things that the map has for what they are, and of n submaps that it has for one."""
    known_of_a_kind: float
    """As `of_a_kind`, likewise: what falls short of 1 here is the query's fault, and the rest the map's."""
    names_unique: int
    names_of_a_kind: int


def ask_names(panoptic_map: PanopticMap, truth: SurfaceTruth, owners: Mapping[int, int]) -> list[Asked]:
    """Every name of the simulated front end for every visible thing that the map has.

    Parameters
    ----------
    owners : submap -> the instance that it mainly is, or 0 (`instances.main_instances`).
    """
    submaps: dict[int, set[int]] = defaultdict(set)
    for submap, instance in owners.items():
        submaps[instance].add(submap)
    visible = [
        i for i in truth.instances.values() if i.is_thing and (i.pixels or 0) >= MIN_PIXELS and submaps.get(i.id)
    ]
    retriever = PrototypeRetriever()
    category = {i.id: retriever.retrieve([i.name])[0].id for i in visible}
    called: dict[str, list[int]] = defaultdict(list)
    for instance in visible:
        row = name_table().get(instance.name)
        for name in dict.fromkeys(map(lemmatize, row.names if row else (instance.name,))):
            called[name].append(instance.id)
    asked = []
    for name, meant in called.items():
        answers = [answer.submap for answer in panoptic_map.rank(name)]
        kinds = {category[thing] for thing in meant}
        kind = sum(own in kinds for own in category.values())
        so_called = {s.id for s in answers if s.descriptor and s.descriptor.category.id in kinds}
        for thing in meant:
            own = submaps[thing]
            place = next((n for n, s in enumerate(answers, start=1) if s.id in own), len(answers) + 1)
            known, so = bool(so_called & own), len(so_called)
            asked.append(Asked(name=name, thing=thing, kind=kind, place=place, known=known, called=so))
    return asked


def synonym_metrics(asked: Sequence[Asked]) -> SynonymMetrics:
    """What the answers come to."""
    unique = [a for a in asked if a.kind == 1]
    others = [a for a in asked if a.kind > 1]
    whole = [all(a.right for a in unique if a.thing == thing) for thing in {a.thing for a in unique}]
    return SynonymMetrics(
        unique=float(np.mean([a.right for a in unique])),
        unique_things=float(np.mean(whole)),
        of_a_kind=float(np.mean([a.right for a in others])),
        known_unique=float(np.mean([a.as_the_map_has_it for a in unique if a.known])),
        known_of_a_kind=float(np.mean([a.as_the_map_has_it for a in others if a.known])),
        names_unique=len(unique),
        names_of_a_kind=len(others),
    )
