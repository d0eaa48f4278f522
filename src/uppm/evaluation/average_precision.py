"""Mean average precision of things: segments ranked by score, matched by IoU."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.evaluation.overlaps import Overlaps

THRESHOLDS = (0.3, 0.4, 0.5)
"""IoU, as in the paper's table."""


@dataclass(frozen=True, kw_only=True)
class RankedMatch:
    """One predicted segment: the class that it counts under, its score, and whether it met an instance."""

    name: str
    score: float
    is_match: bool


@dataclass(frozen=True, kw_only=True)
class ImageMatches:
    """Predictions of one image (or surface) and the classes of its true things."""

    predictions: tuple[RankedMatch, ...]
    truth: tuple[str, ...]


def match_by_score(table: Overlaps, min_iou: float) -> ImageMatches:
    """Best score first, each prediction takes the free thing of a right class with the highest IoU >= `min_iou`.

    Predictions of the truth's stuff, and those more than half in the void, are left out.
    """
    things = np.array([t.is_thing for t in table.truth], dtype=bool)
    iou = np.where(table.right_class & things[:, None], table.iou, 0.0)
    ignored = table.is_stuff | (table.void_area > table.predicted_area)
    found: list[RankedMatch] = []
    for p in sorted(np.flatnonzero(~ignored), key=lambda p: -table.predicted[p].score):
        segment = table.predicted[p]
        best = int(iou[:, p].argmax()) if len(iou) else -1
        is_match = best >= 0 and bool(iou[best, p] >= min_iou)
        if is_match:
            iou[best] = 0.0
        name = table.truth[best].classes[0] if is_match else segment.name
        found.append(RankedMatch(name=name, score=segment.score, is_match=is_match))
    truth = tuple(t.classes[0] for t in table.truth if t.is_thing)
    return ImageMatches(predictions=tuple(found), truth=truth)


def average_precision(is_match: npt.NDArray[np.bool_], truth: int) -> float:
    """Area under the precision-recall curve, precision made monotone (as PASCAL VOC since 2010).

    Parameters
    ----------
    is_match : (N,) bool, predictions by falling score.
    truth : true instances, at least 1.
    """
    hits = np.cumsum(is_match)
    precision = hits / np.arange(1, len(hits) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(envelope[is_match].sum() / truth)


def mean_average_precision(tables: Sequence[Overlaps], min_iou: float) -> float | None:
    """Mean over the classes that have a true thing; None where none has."""
    images = [match_by_score(table, min_iou) for table in tables]
    truth = [name for image in images for name in image.truth]
    found = [_class_precision(images, name, truth.count(name)) for name in sorted(set(truth))]
    return float(np.mean(found)) if found else None


def _class_precision(images: Iterable[ImageMatches], name: str, truth: int) -> float:
    ranked = [p for image in images for p in image.predictions if p.name == name]
    ranked.sort(key=lambda p: -p.score)
    return average_precision(np.array([p.is_match for p in ranked], dtype=bool), truth)
