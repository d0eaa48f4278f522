"""Which submap a phrase means, how sure that is, and whether it is there at all (docs/retrieval.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.categories import plain_name
from uppm.core.types import DynamicDescriptor, Submap

Vector = npt.NDArray[np.float32]
Values = npt.NDArray[np.float64]

FOUND_PROBABILITY = 0.5
"""At least so probable must an answer be to count as found."""
RARE_LABEL_PENALTY = 0.1
"""Cosine that a label of vanishing share in its submap's votes loses."""
WEIGHTS = (-2.61, 14.42, 14.26)
"""Logistic regression on 1, the label's cosine and the category's; fitted by tools/calibrate_query.py."""


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
        """The submap is more likely meant than not."""
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
    """

    def __init__(
        self,
        submaps: Iterable[Submap],
        label_embeddings: Mapping[str, Vector],
        category_embeddings: Mapping[int, Vector],
    ) -> None:
        described = [(s, s.descriptor) for s in submaps if s.descriptor and s.descriptor.labels]
        self._submaps = [submap for submap, _ in described]
        self._ids = np.array([submap.id for submap in self._submaps], dtype=np.int64)
        self._records = _Records([d for _, d in described])
        self._texts = _Texts(self._records.texts, label_embeddings)
        self._categories = _Categories([d for _, d in described], category_embeddings)

    def rank(self, phrase: str, vector: Vector, closest: int | None = None) -> list[Answer]:
        """The submaps that are found, and in any case the `closest` best (None: all), the most probable first.

        Nothing is there where the first is not `found`.

        Parameters
        ----------
        phrase : str
            The query, lemmatised as the labels are.
        vector : (D,)
            Its unit embedding.
        """
        if not self._submaps:
            return []
        features, best = self.evidence(phrase, vector)
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

    def evidence(self, phrase: str, vector: Vector) -> tuple[Values, npt.NDArray[np.intp]]:
        """(N, 3) 1, the best label's cosine, and by how much the category falls behind the best one (<= 0).

        And (N,) the record that matched best. A catch-all category ('furniture-other') says nothing about what the
        object is: the label stands in for it. A category that is called what was asked for is no worse than any other.
        """
        records = self._records
        matches = self._texts.cosines(phrase, vector)[records.text] - RARE_LABEL_PENALTY * (1 - records.share)
        best = records.best(matches)
        label = matches[best]
        category = self._categories.lag(phrase, vector, label)
        return np.stack([np.ones_like(label), label, category], axis=1), best


class _Records:
    """The label records of N descriptors, R in all, one after the other.

    `texts` are the distinct label texts; `text` (R,) numbers in these; `share` (R,) of the descriptor's vote weight.
    """

    def __init__(self, descriptors: list[DynamicDescriptor]) -> None:
        number: dict[str, int] = {}
        rows = [number.setdefault(r.text, len(number)) for d in descriptors for r in d.labels]
        self.texts, self.text = list(number), np.array(rows, dtype=np.intp)
        counts = np.array([len(d.labels) for d in descriptors], dtype=np.intp)
        self._starts = np.cumsum(counts) - counts
        self._owner = np.repeat(np.arange(len(counts)), counts)
        weight = np.array([r.weight for d in descriptors for r in d.labels], dtype=np.float64)
        total = np.bincount(self._owner, weight, minlength=len(counts))[self._owner]
        self.share = np.divide(weight, total, out=np.ones_like(weight), where=total > 0)

    def best(self, values: Values) -> npt.NDArray[np.intp]:
        """(N,) record of the greatest value (R,) of each descriptor, the first of equals."""
        is_best = np.flatnonzero(values == np.maximum.reduceat(values, self._starts)[self._owner])
        return is_best[np.searchsorted(is_best, self._starts)]


class _Texts:
    """Label texts and their vectors."""

    def __init__(self, texts: list[str], vectors: Mapping[str, Vector]) -> None:
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
    """The categories of N descriptors, and the vectors of all categories."""

    def __init__(self, descriptors: list[DynamicDescriptor], embeddings: Mapping[int, Vector]) -> None:
        row = {id_: n for n, id_ in enumerate(embeddings)}
        blocks = [np.atleast_2d(vectors) for vectors in embeddings.values()]
        self._vectors = np.concatenate(blocks) if blocks else None
        counts = np.array([len(block) for block in blocks], dtype=np.intp)
        self._starts = np.cumsum(counts) - counts
        names = [d.category.name for d in descriptors]
        self._names = np.array([plain_name(name) for name in names])
        self._row = np.array(
            [-1 if d.category.name.endswith("-other") else row.get(d.category.id, -1) for d in descriptors],
            dtype=np.intp,
        )

    def lag(self, phrase: str, vector: Vector, label: Values) -> Values:
        """(N,) by how much each falls behind the best of all categories, 0 where it does not; `label` (N,) stands in
        for a category that has no vectors, or no meaning of its own."""
        if self._vectors is None:
            return np.zeros_like(label)
        fits = np.maximum.reduceat((self._vectors @ vector).astype(np.float64), self._starts)
        own = np.where(self._row >= 0, fits[self._row], label)
        lag = np.minimum(np.maximum(own, label) - fits.max(), 0.0)
        return np.where(self._names == phrase, 0.0, lag)
