"""Which submap a phrase means, how sure that is, and whether it is there at all (docs/retrieval.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.categories import plain_name, unified_categories
from uppm.core.types import DynamicDescriptor, Submap

Vector = npt.NDArray[np.float32]
Values = npt.NDArray[np.float64]

FOUND_PROBABILITY = 0.5
"""At least so probable must an answer be to count as found; chosen on what tools/calibrate_query.py prints."""
TEMPERATURE = 0.1
"""Cosine that a label is worth behind one of e times its share of an object's votes."""
WEIGHTS = (-1.7, 9.47, 10.36, 10.0)
"""Of 1, labels, categories and looks; but for the last, logistic regression by tools/calibrate_query.py."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """One submap that the phrase may mean."""

    submap: Submap
    label: str
    """The submap's label that matched best."""
    score: float
    """Log-odds that the submap is meant; the order of the answers."""
    probability: float
    """0 to 1, calibrated."""

    @property
    def found(self) -> bool:
        """The submap is probable enough."""
        return self.probability >= FOUND_PROBABILITY


class SearchIndex:
    """All that phrases are compared with, as matrices: made once of a map, then a product of matrices a phrase.

    Parameters
    ----------
    submaps : those without a label are left out.
    label_embeddings : mapping
        Label text -> unit vector (D,); labels without one can match by their text only.
    category_embeddings : mapping
        Category id -> unit vectors (D,) or (K, D) of its name or names, of all categories: whether the query means
        something that the map lacks is judged by them.
    category_looks : (C, E), optional
        The categories' names by the text side of the model that made the submaps' visual features; None: these do
        not count.
    """

    def __init__(
        self,
        submaps: Iterable[Submap],
        label_embeddings: Mapping[str, Vector],
        category_embeddings: Mapping[int, Vector],
        category_looks: Vector | None = None,
    ) -> None:
        described = [(s, s.descriptor) for s in submaps if s.descriptor and s.descriptor.labels]
        descriptors = [descriptor for _, descriptor in described]
        self._submaps = [submap for submap, _ in described]
        self._ids = np.array([submap.id for submap in self._submaps], dtype=np.int64)
        self._records = _Records(descriptors)
        self._texts = _Texts(self._records.texts, label_embeddings)
        self._categories = _Categories(descriptors, category_embeddings)
        self._looks = _Looks(descriptors, category_looks)

    def rank(self, phrase: str, vector: Vector, closest: int | None = None, look: Vector | None = None) -> list[Answer]:
        """The submaps that are found, and in any case the `closest` best (None: all), the most probable first.

        Nothing is there where the first is not `found`.

        Parameters
        ----------
        phrase : str
            The query, lemmatised as the labels are.
        vector : (D,)
            Its unit embedding.
        look : (E,), optional
            The phrase by the encoder that made `category_looks`.
        """
        if not self._submaps:
            return []
        features, best = self.evidence(phrase, vector, look)
        scores = features @ np.array(WEIGHTS)
        probabilities = np.exp(-np.logaddexp(0, -scores))
        order = np.lexsort((self._ids, -scores))
        if closest is not None:
            order = order[: max(closest, int((probabilities >= FOUND_PROBABILITY).sum()))]
        return [
            Answer(
                submap=self._submaps[n],
                label=self._records.texts[self._records.text[best[n]]],
                score=float(scores[n]),
                probability=float(probabilities[n]),
            )
            for n in order.tolist()
        ]

    def evidence(self, phrase: str, vector: Vector, look: Vector | None = None) -> tuple[Values, npt.NDArray[np.intp]]:
        """(N, 4) what speaks for each submap, and (N,) the record that matched best.

        Columns: 1; its labels; its categories; how it looks. A submap was called its labels in shares w of the vote
        weight (count times confidence), so that its likeness to the phrase is T log sum w exp(cosine / T), over all
        labels. The same over its labels' categories is taken less the cosine of the best of all categories, and
        is 0 or negative: a phrase that fits some category much better means something else. A catch-all
        ('furniture-other') says nothing about what a thing is, and the label stands in for it; a category that is
        called what was asked for is no worse than any other. Looks: by how much the phrase falls behind the category
        that the submap looks most like, 0 where it does not or where there is no feature.
        """
        records = self._records
        cosines = self._texts.cosines(phrase, vector)[records.text]
        labels = records.mixed(cosines)
        fits, best = self._categories.fits(phrase, vector, cosines)
        lag = np.zeros_like(labels) if best is None else np.minimum(np.maximum(records.mixed(fits), labels) - best, 0)
        features = np.stack([np.ones_like(labels), labels, lag, self._looks.lag(look)], axis=1)
        return features, records.first_of_best(cosines + TEMPERATURE * np.log(records.share))


class _Records:
    """The label records of N descriptors, R in all, one after the other.

    `texts` are the distinct label texts; `text` (R,) numbers in these; `share` (R,) of the descriptor's vote weight;
    `owner` (R,) numbers of descriptors.
    """

    def __init__(self, descriptors: Sequence[DynamicDescriptor]) -> None:
        number: dict[str, int] = {}
        rows = [number.setdefault(r.text, len(number)) for d in descriptors for r in d.labels]
        self.texts, self.text = list(number), np.array(rows, dtype=np.intp)
        counts = np.array([len(d.labels) for d in descriptors], dtype=np.intp)
        self._starts = np.cumsum(counts) - counts
        self.owner = np.repeat(np.arange(len(counts)), counts)
        weight = np.array([r.weight for d in descriptors for r in d.labels], dtype=np.float64)
        total = np.bincount(self.owner, weight, minlength=len(counts))[self.owner]
        share = np.divide(weight, total, out=np.ones_like(weight), where=total > 0)
        self.share = np.maximum(share, 1e-9)

    def mixed(self, values: Values) -> Values:
        """(N,) T log sum w exp(value / T) of the values (R,) of each descriptor's records, of shares w."""
        most = np.maximum.reduceat(values, self._starts)
        raised = self.share * np.exp((values - most[self.owner]) / TEMPERATURE)
        return most + TEMPERATURE * np.log(np.add.reduceat(raised, self._starts))

    def first_of_best(self, values: Values) -> npt.NDArray[np.intp]:
        """(N,) record of the greatest value (R,) of each descriptor, the first of equals."""
        is_best = np.flatnonzero(values == np.maximum.reduceat(values, self._starts)[self.owner])
        return is_best[np.searchsorted(is_best, self._starts)]


class _Texts:
    """Label texts and their vectors."""

    def __init__(self, texts: Sequence[str], vectors: Mapping[str, Vector]) -> None:
        self._row = {text: row for row, text in enumerate(texts)}
        self._known = np.array([row for text, row in self._row.items() if text in vectors], dtype=np.intp)
        known = [vectors[text] for text in texts if text in vectors]
        self._vectors = np.stack(known) if known else None

    def cosines(self, phrase: str, vector: Vector) -> Values:
        """(U,) with each text: 1 for the same one, -1 for one without a vector."""
        found = np.full(len(self._row), -1.0)
        if self._vectors is not None:
            found[self._known] = self._vectors @ vector
        if phrase in self._row:
            found[self._row[phrase]] = 1.0
        return found


class _Categories:
    """The category of each label record, and the vectors of all categories."""

    def __init__(self, descriptors: Sequence[DynamicDescriptor], embeddings: Mapping[int, Vector]) -> None:
        blocks = [np.atleast_2d(vectors) for vectors in embeddings.values()]
        self._vectors = np.concatenate(blocks) if blocks else None
        counts = np.array([len(block) for block in blocks], dtype=np.intp)
        self._starts = np.cumsum(counts) - counts
        row = {id_: n for n, id_ in enumerate(embeddings)}
        names = {category.id: category.name for category in unified_categories()}
        meant = [id_ for d in descriptors for id_ in _categories_of(d)]
        catch_all = [names.get(id_, "").endswith("-other") for id_ in meant]
        self._row = np.array(
            [-1 if other else row.get(id_, -1) for id_, other in zip(meant, catch_all, strict=True)], dtype=np.intp
        )
        self._names = np.array([plain_name(names.get(id_, "")) for id_ in meant])

    def fits(self, phrase: str, vector: Vector, cosines: Values) -> tuple[Values, float | None]:
        """(R,) the phrase's cosine with each record's category, and with the best of all; None where none is known.

        `cosines` (R,) of the labels stand in for categories without vectors, or without a meaning of their own.
        """
        if self._vectors is None:
            return cosines, None
        all_fits = np.maximum.reduceat((self._vectors @ vector).astype(np.float64), self._starts)
        best = float(all_fits.max())
        own = np.where(self._row >= 0, all_fits[self._row], cosines)
        return np.where(self._names == phrase, best, own), best


def _categories_of(descriptor: DynamicDescriptor) -> list[int]:
    """The category of each of its records; where nobody doubts the descriptor's (one pinned by hand, say), that."""
    if descriptor.confidence >= 1:
        return [descriptor.category.id] * len(descriptor.labels)
    return [record.category for record in descriptor.labels]


class _Looks:
    """How N submaps look, against how the categories do."""

    def __init__(self, descriptors: Sequence[DynamicDescriptor], categories: Vector | None) -> None:
        self._lags = np.zeros(len(descriptors))
        seen = [(n, d.feature.mean) for n, d in enumerate(descriptors) if d.feature]
        self._features = None
        if seen and categories is not None:
            self._rows = np.array([n for n, _ in seen], dtype=np.intp)
            features = np.stack([mean for _, mean in seen])
            self._features = features / np.linalg.norm(features, axis=1, keepdims=True)
            self._best = (self._features @ categories.T).max(axis=1)

    def lag(self, look: Vector | None) -> Values:
        """(N,)."""
        lags = self._lags.copy()
        if look is not None and self._features is not None:
            lags[self._rows] = np.minimum(self._features @ look - self._best, 0)
        return lags
