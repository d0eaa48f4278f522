"""How well each unified category fits a label (docs/retrieval.md)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval.embeddings import shipped_embeddings
from uppm.perception.retrieval.hypernyms import head_endings, kind_of
from uppm.perception.retrieval.prototypes import lexicon, prototypes

TERM_TEMPERATURE = 0.05
"""Cosine by which a prototype falls behind the best before it stops to matter."""
GLOSS_WEIGHT, BEST_GLOSS_WEIGHT = 0.1, 0.2
"""Of the gloss by hand, and of the best one, WordNet's included."""
HEAD_BONUS = 0.05
"""For the category whose prototype the head noun is."""
KIND_WEIGHT, HEAD_KIND_WEIGHT = 0.25, 0.08
"""Of what WordNet says of the whole label, and of its head alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PrototypeTable:
    """The vectors of all terms and glosses, each with its category's row."""

    terms: npt.NDArray[np.float32]
    """(N, D)."""
    term_rows: npt.NDArray[np.intp]
    """(N,)."""
    keys: npt.NDArray[np.str_]
    """(N,) lemmatised texts of the terms without blanks."""
    glosses: npt.NDArray[np.float32]
    """(171, D), by hand."""
    more_glosses: npt.NDArray[np.float32]
    """(M, D), WordNet's."""
    more_rows: npt.NDArray[np.intp]
    """(M,)."""


@cache
def prototype_table() -> PrototypeTable:
    """The shipped vectors of the prototypes."""
    vectors, rows = shipped_embeddings(), prototypes()
    terms = [(term, n) for n, row in enumerate(rows) for term in (*row.terms, *row.wordnet_terms)]
    more = [(gloss, n) for n, row in enumerate(rows) for gloss in row.wordnet_glosses]
    return PrototypeTable(
        terms=np.stack([vectors[term] for term, _ in terms]),
        term_rows=np.array([n for _, n in terms]),
        keys=np.array([_key(lemmatize(term)) for term, _ in terms]),
        glosses=np.stack([vectors[row.gloss] for row in rows]),
        more_glosses=np.stack([vectors[gloss] for gloss, _ in more]),
        more_rows=np.array([n for _, n in more]),
    )


def _key(phrase: str) -> str:
    """Blanks do not tell two terms apart: `bookshelf`, `book shelf`."""
    return phrase.replace(" ", "")


def category_scores(
    vector: npt.NDArray[np.float32], phrase: str, *, leave_out: bool = False
) -> npt.NDArray[np.float64]:
    """(171,): likeness to a category's terms and glosses, and what the head noun is a kind of.

    `leave_out` takes the phrase's own entry out of the table, as if it had not been foreseen; for evaluation.
    """
    table = prototype_table()
    closeness = np.exp(((table.terms @ vector).astype(np.float64) - 1) / TERM_TEMPERATURE)
    if leave_out:
        closeness[table.keys == _key(phrase)] = 0
    sums = np.bincount(table.term_rows, weights=closeness, minlength=len(table.glosses))
    gloss = (table.glosses @ vector).astype(np.float64)
    best = gloss.copy()
    np.maximum.at(best, table.more_rows, table.more_glosses @ vector)
    scores = TERM_TEMPERATURE * np.log(sums + 1e-30) + 1 + GLOSS_WEIGHT * gloss + BEST_GLOSS_WEIGHT * best
    head, kind = known_head(phrase), kind_of(phrase)
    if head is not None:
        scores[lexicon()[head]] += HEAD_BONUS
    return scores + (KIND_WEIGHT if kind.whole else HEAD_KIND_WEIGHT) * kind.evidence


def known_head(phrase: str) -> str | None:
    """The longest proper part of a noun phrase that ends in its head and is a term: 'tall red lamp' -> 'lamp'."""
    return next((ending for ending in head_endings(phrase) if ending != phrase and ending in lexicon()), None)


def softmax(scores: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Probabilities of scores."""
    raised = np.exp(scores - scores.max())
    return raised / raised.sum()
