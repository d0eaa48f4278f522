"""Which submap a phrase means, how sure that is, and whether it is there at all (docs/retrieval.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.categories import plain_name
from uppm.core.types import DynamicDescriptor, LabelRecord, Submap

Vector = npt.NDArray[np.float32]

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


def rank(
    phrase: str,
    vector: Vector,
    submaps: Sequence[Submap],
    label_embeddings: Mapping[str, Vector],
    category_embeddings: Mapping[int, Vector],
) -> list[Answer]:
    """Every submap with a descriptor, the most probable first; nothing is there where the first is not `found`.

    Parameters
    ----------
    phrase : str
        The query, lemmatised as the labels are.
    vector : (D,)
        Its unit embedding.
    label_embeddings : mapping
        Label text -> unit vector (D,); labels without one can match by their text only.
    category_embeddings : mapping
        Category id -> unit vectors (D,) or (K, D) of its name or names, of all categories: whether the query means
        something that the map lacks is judged by them.
    """
    fits = {key: float((np.atleast_2d(vectors) @ vector).max()) for key, vectors in category_embeddings.items()}
    answers = []
    for submap in submaps:
        if submap.descriptor is None or not submap.descriptor.labels:
            continue
        label, features = evidence(phrase, vector, submap.descriptor, label_embeddings, fits)
        score = float(np.dot(WEIGHTS, (1.0, *features)))
        probability = float(np.exp(-np.logaddexp(0, -score)))
        answers.append(Answer(submap=submap, label=label, score=score, probability=probability))
    return sorted(answers, key=lambda answer: (-answer.score, answer.submap.id))


def evidence(
    phrase: str,
    vector: Vector,
    descriptor: DynamicDescriptor,
    label_embeddings: Mapping[str, Vector],
    fits: Mapping[int, float],
) -> tuple[str, tuple[float, float]]:
    """The label that matches best; its cosine, and by how much the category's falls behind the best category's (<= 0).

    `fits` is the query's cosine with each category. A catch-all ('furniture-other') says nothing about what the object
    is: the label stands in for it. A category that is called what was asked for is no worse than any other.
    """
    total = sum(record.weight for record in descriptor.labels)
    matches = [(_label_match(phrase, vector, r, total, label_embeddings), r.text) for r in descriptor.labels]
    label_score, label = max(matches)
    name = descriptor.category.name
    if phrase == plain_name(name):
        return label, (label_score, 0.0)
    own = label_score if name.endswith("-other") else fits.get(descriptor.category.id, label_score)
    return label, (label_score, min(max(own, label_score) - max(fits.values(), default=label_score), 0.0))


def _label_match(
    phrase: str, vector: Vector, record: LabelRecord, total: float, label_embeddings: Mapping[str, Vector]
) -> float:
    known = label_embeddings.get(record.text)
    cosine = 1.0 if record.text == phrase else float(known @ vector) if known is not None else -1.0
    share = record.weight / total if total > 0 else 1.0
    return cosine - RARE_LABEL_PENALTY * (1 - share)
