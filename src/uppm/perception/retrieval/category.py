"""Label text -> unified category: the paper's way, and ours (docs/retrieval.md)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from uppm.core.categories import category_by_name, label_category, plain_name, unified_categories
from uppm.core.protocols import TextEncoder
from uppm.core.types import Category
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval.embeddings import LabelEmbeddings, shipped_embeddings
from uppm.perception.retrieval.prototypes import lexicon, prototypes
from uppm.perception.retrieval.scores import category_scores, softmax

SOFTMAX_TEMPERATURE = 0.063
"""At which the probabilities are calibrated on words that are not in the table."""
MIN_PROBABILITY = 0.15
"""Below it no single category is good, and the supercategory answers."""

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


class LabelRetriever:
    """Each label is a category of its own, all of one size: no unified semantics (the paper's PPM, section 4.6)."""

    def retrieve(self, texts: Sequence[str]) -> tuple[Category, ...]:
        """One category a text."""
        return tuple(map(label_category, texts))


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
    """Names, synonyms and glosses of each category; the head noun apart; a catch-all when nothing is good.

    Parameters
    ----------
    encoder : TextEncoder, optional
        None: `LabelEmbeddings`.
    leave_out : bool
        Judge each label without its own entry in the table, as if it had not been foreseen; for evaluation.
    """

    def __init__(self, encoder: TextEncoder | None = None, *, leave_out: bool = False) -> None:
        self._encoder = encoder if encoder is not None else LabelEmbeddings()
        self._leave_out = leave_out
        self._known: dict[str, Category] = {}

    def retrieve(self, texts: Sequence[str]) -> tuple[Category, ...]:
        """One category a text."""
        for text in texts:
            if text not in self._known:
                self._known[text] = self._find(lemmatize(text))
        return tuple(self._known[text] for text in texts)

    def _find(self, phrase: str) -> Category:
        row = None if self._leave_out else lexicon().get(phrase)
        if row is not None:
            return unified_categories()[row]
        scores = category_scores(self._encoder.encode([phrase])[0], phrase, leave_out=self._leave_out)
        return choose(softmax(scores / SOFTMAX_TEMPERATURE))


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
    """Category id -> unit vectors (K, D) of its terms and gloss; what `uppm.map.query` compares a query with."""
    vectors = shipped_embeddings()
    return {row.category.id: np.stack([vectors[text] for text in (*row.terms, row.gloss)]) for row in prototypes()}
