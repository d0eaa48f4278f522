"""Label text -> unified category: the paper's way, and ours (docs/retrieval.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from uppm.core.categories import category_by_name, plain_name, unified_categories
from uppm.core.protocols import TextEncoder
from uppm.core.types import Category
from uppm.perception.labels.lemma import head_index, lemmatize
from uppm.perception.retrieval.embeddings import LabelEmbeddings, shipped_embeddings
from uppm.perception.retrieval.prototypes import prototypes

TERM_TEMPERATURE = 0.05
"""Cosine by which a prototype falls behind the best before it stops to matter."""
GLOSS_WEIGHT = 0.2
HEAD_BONUS = 0.1
SOFTMAX_TEMPERATURE = 0.05
MIN_PROBABILITY = 0.2
"""Below it no single category is good, and the supercategory answers."""
MEASURES = frozenset(
    ("pair", "stack", "pile", "heap", "bunch", "set", "piece", "slice", "row", "group", "lot", "couple")
)
"""What comes before `of` without being the thing."""

_CATCH_ALL = {
    "furniture": "furniture-other",
    "furniture-stuff": "furniture-other",
    "food": "food-other",
    "food-stuff": "food-other",
    "textile": "textile-other",
    "building": "building-other",
    "ground": "ground-other",
    "plant": "plant-other",
    "wall": "wall-other",
    "floor": "floor-other",
    "ceiling": "ceiling-other",
    "window": "window-other",
    "water": "water-other",
    "sky": "sky-other",
    "structural": "structural-other",
}
_LIVING_OR_MOVING = ("person", "animal", "vehicle")
"""Supercategories without a catch-all: their best category answers."""


class PaperRetriever:
    """c(o) = argmax_c cos(E(o), E(c)) over the categories' names as one says them (paper equation 1)."""

    def __init__(self, encoder: TextEncoder | None = None) -> None:
        self._encoder = encoder if encoder is not None else LabelEmbeddings()
        self._known: dict[str, Category] = {}

    def retrieve(self, texts: Sequence[str]) -> tuple[Category, ...]:
        """One category a text."""
        new = [text for text in dict.fromkeys(texts) if text not in self._known]
        if new:
            best = (self._encoder.encode(new) @ _name_vectors().T).argmax(axis=1)
            self._known.update((text, unified_categories()[row]) for text, row in zip(new, best, strict=True))
        return tuple(self._known[text] for text in texts)


class PrototypeRetriever:
    """Names, synonyms and a gloss of each category; head noun apart; a catch-all when nothing is good."""

    def __init__(self, encoder: TextEncoder | None = None) -> None:
        self._encoder = encoder if encoder is not None else LabelEmbeddings()
        self._known: dict[str, Category] = {}

    def retrieve(self, texts: Sequence[str]) -> tuple[Category, ...]:
        """One category a text."""
        for text in texts:
            if text not in self._known:
                self._known[text] = self._find(lemmatize(text))
        return tuple(self._known[text] for text in texts)

    def _find(self, phrase: str) -> Category:
        row = lexicon().get(phrase)
        if row is not None:
            return unified_categories()[row]
        scores = category_scores(self._encoder.encode([phrase])[0], phrase)
        return choose(softmax(scores / SOFTMAX_TEMPERATURE))


@dataclass(frozen=True, kw_only=True, eq=False)
class PrototypeTable:
    """All terms' vectors, category by category."""

    terms: npt.NDArray[np.float32]
    """(N, D)."""
    phrases: tuple[str, ...]
    """Lemmatised text of each term."""
    starts: npt.NDArray[np.intp]
    """(171,) first term of each category."""
    glosses: npt.NDArray[np.float32]
    """(171, D)."""


@cache
def prototype_table() -> PrototypeTable:
    """The shipped vectors of the prototypes."""
    vectors, rows = shipped_embeddings(), prototypes()
    sizes = [len(row.terms) for row in rows]
    return PrototypeTable(
        terms=np.stack([vectors[term] for row in rows for term in row.terms]),
        phrases=tuple(lemmatize(term) for row in rows for term in row.terms),
        starts=np.cumsum([0, *sizes[:-1]]),
        glosses=np.stack([vectors[row.gloss] for row in rows]),
    )


@cache
def lexicon() -> dict[str, int]:
    """Lemmatised name or term -> row of the category table."""
    found: dict[str, int] = {}
    for number, row in enumerate(prototypes()):
        for text in (row.category.name, plain_name(row.category.name), *row.terms):
            found.setdefault(lemmatize(text), number)
    return found


def category_scores(
    vector: npt.NDArray[np.float32], phrase: str, *, leave_out: bool = False
) -> npt.NDArray[np.float64]:
    """(171,): soft maximum of the cosines with a category's terms, plus its gloss's, plus a bonus for the head noun.

    `leave_out` takes the phrase's own entry out of the table, as if it had not been foreseen; for evaluation.
    """
    table = prototype_table()
    cosines = (table.terms @ vector).astype(np.float64)
    closeness = np.exp((cosines - 1) / TERM_TEMPERATURE)
    if leave_out:
        own = phrase.replace(" ", "")
        closeness[[other.replace(" ", "") == own for other in table.phrases]] = 0
    terms = TERM_TEMPERATURE * np.log(np.add.reduceat(closeness, table.starts) + 1e-30) + 1
    scores = terms + GLOSS_WEIGHT * (table.glosses @ vector)
    head = known_head(phrase)
    if head is not None:
        scores[lexicon()[head]] += HEAD_BONUS
    return scores


def known_head(phrase: str) -> str | None:
    """The longest proper part of a noun phrase that ends in its head and is a term: 'tall red lamp' -> 'lamp'."""
    words = phrase.split()
    while len(words) > 2 and words[0] in MEASURES and words[1] == "of":
        words = words[2:]
    end = head_index(words) + 1 if words else 0
    endings = (lemmatize(" ".join(words[start:end])) for start in range(end))
    return next((ending for ending in endings if ending != phrase and ending in lexicon()), None)


def softmax(scores: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Probabilities of scores."""
    raised = np.exp(scores - scores.max())
    return raised / raised.sum()


def choose(probabilities: npt.NDArray[np.float64]) -> Category:
    """The most probable category; where none is probable enough, the catch-all of the most probable group of them."""
    if probabilities.max() >= MIN_PROBABILITY:
        return unified_categories()[int(probabilities.argmax())]
    groups = catch_alls()
    totals = {group: float(probabilities[[g == group for g in groups]].sum()) for group in set(groups)}
    group = max(sorted(totals), key=totals.__getitem__)
    if group in category_by_name():
        return category_by_name()[group]
    inside = np.where([g == group for g in groups], probabilities, -1.0)
    return unified_categories()[int(inside.argmax())]


@cache
def catch_alls() -> tuple[str, ...]:
    """Each category's group: the name of its supercategory's catch-all, or of the supercategory that has none.

    Small man-made things (kitchen, electronic, indoor, raw material, ...) share `solid-other`.
    """
    return tuple(
        c.supercategory if c.supercategory in _LIVING_OR_MOVING else _CATCH_ALL.get(c.supercategory, "solid-other")
        for c in unified_categories()
    )


@cache
def _name_vectors() -> npt.NDArray[np.float32]:
    return np.stack([shipped_embeddings()[plain_name(category.name)] for category in unified_categories()])


@cache
def category_vectors() -> dict[int, npt.NDArray[np.float32]]:
    """Category id -> unit vectors (K, D) of its terms and gloss; what `uppm.map.query.rank` compares a query with."""
    table = prototype_table()
    terms = np.split(table.terms, table.starts[1:])
    return {
        row.category.id: np.vstack([own, gloss])
        for row, own, gloss in zip(prototypes(), terms, table.glosses, strict=True)
    }
