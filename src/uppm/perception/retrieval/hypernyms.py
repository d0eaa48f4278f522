"""What WordNet knows of a label: which unified categories its head noun is a kind of.

`category_synsets.csv` names by hand the synsets that each category stands for, broad ones for the catch-alls. A noun's
senses are followed up to the nearest of them: a credenza is a kind of sideboard, which is a `cabinet`.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources

import numpy as np
import numpy.typing as npt

from uppm.core.categories import category_by_name, unified_categories
from uppm.perception.labels.lemma import head_index, lemmatize
from uppm.perception.labels.wordnet import wordnet
from uppm.perception.labels.words import MEASURES

SENSES = 8
"""Rarer senses of a noun are not followed."""
SENSE_DECAY = 0.8
"""By how much each sense counts less than the one before, which is commoner."""
STEP_DECAY = 0.8
"""By how much each step up counts less."""
LIVING_SHARE = 0.4
"""What is left of a person or an animal where another sense is a thing: a mouse on a desk, a doormat."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind:
    """What WordNet says of one label."""

    evidence: npt.NDArray[np.float64]
    """(171,), 0 to 1: how closely a sense of the noun is a kind of each category."""
    whole: bool
    """WordNet knows the whole label, not its head alone."""


@lru_cache(maxsize=4096)
def kind_of(phrase: str) -> Kind:
    """The categories above the longest ending of the phrase's head that WordNet knows; all zero where there is none."""
    for ending in head_endings(phrase):
        evidence = _evidence(wordnet().synsets_of(ending)[:SENSES])
        if evidence.any():
            return Kind(evidence=evidence, whole=ending == phrase)
    return Kind(evidence=np.zeros(len(unified_categories())), whole=False)


def _evidence(senses: tuple[int, ...]) -> npt.NDArray[np.float64]:
    evidence = np.zeros(len(unified_categories()))
    for rank, sense in enumerate(senses):
        above = (
            (category_of_synset()[s], steps) for s, steps in wordnet().ancestors(sense) if s in category_of_synset()
        )
        for category, steps in above:
            evidence[category] = max(evidence[category], SENSE_DECAY**rank * STEP_DECAY**steps)
            break
    living = _living()
    return np.where(living, LIVING_SHARE * evidence, evidence) if evidence[~living].any() else evidence


def head_endings(phrase: str) -> Iterator[str]:
    """Parts of a noun phrase that end in its head, the longest first: 'tall red lamp' -> itself, 'red lamp', 'lamp'."""
    words = phrase.split()
    while len(words) > 2 and words[0] in MEASURES and words[1] == "of":
        words = words[2:]
    end = head_index(words) + 1 if words else 0
    return (lemmatize(" ".join(words[start:end])) for start in range(end))


@cache
def category_of_synset() -> Mapping[int, int]:
    """Synset -> row of the category table."""
    position = {offset: number for number, offset in enumerate(wordnet().synsets)}
    rows = {category: number for number, category in enumerate(unified_categories())}
    return {
        position[offset]: rows[category_by_name()[name]] for name, synsets in curated_synsets() for _, offset in synsets
    }


def curated_synsets() -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Category name, and (word, offset) of each synset that it stands for."""
    table = resources.files("uppm.data").joinpath("category_synsets.csv").read_text(encoding="utf-8")
    for row in csv.DictReader(table.splitlines()):
        entries = (entry.rpartition(":") for entry in row["synsets"].split("|") if entry)
        yield row["name"], [(word, offset) for word, _, offset in entries]


@cache
def _living() -> npt.NDArray[np.bool_]:
    return np.array([category.supercategory in ("person", "animal") for category in unified_categories()])
