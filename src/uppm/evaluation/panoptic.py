"""Panoptic quality (Kirillov et al., CVPR 2019), on images or on points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from uppm.core.categories import category_by_name
from uppm.evaluation.overlaps import Overlaps

MIN_IOU = 0.5
"""Matches have more than this, so that each segment has at most one."""


@dataclass(frozen=True, kw_only=True)
class ClassCounts:
    """Matches of one class over all images."""

    is_thing: bool
    tp: int = 0
    fp: int = 0
    fn: int = 0
    iou: float = 0.0
    """Sum over the matches."""

    @property
    def sq(self) -> float:
        """Segmentation quality: mean IoU of the matches; 0 where there are none."""
        return self.iou / self.tp if self.tp else 0.0

    @property
    def rq(self) -> float:
        """Recognition quality: F1 of the matches."""
        total = self.tp + self.fp / 2 + self.fn / 2
        return self.tp / total if total else 0.0

    @property
    def pq(self) -> float:
        """Panoptic quality: SQ times RQ."""
        return self.sq * self.rq

    def __add__(self, other: ClassCounts) -> ClassCounts:
        return ClassCounts(
            is_thing=self.is_thing,
            tp=self.tp + other.tp,
            fp=self.fp + other.fp,
            fn=self.fn + other.fn,
            iou=self.iou + other.iou,
        )


@dataclass(frozen=True, kw_only=True)
class QualityMeans:
    """Means over some classes; None without any."""

    pq: float | None
    rq: float | None
    sq: float | None


@dataclass(frozen=True, kw_only=True)
class PanopticQuality:
    """Means over the classes that occur in truth or prediction, as panopticapi takes them."""

    all: QualityMeans
    things: QualityMeans
    stuff: QualityMeans
    classes: int
    """Classes in the mean."""
    classes_without_truth: int
    """Those of them that only were predicted, wrongly: each is a 0 in the mean."""
    per_class: Mapping[str, ClassCounts]


def count_matches(table: Overlaps) -> dict[str, ClassCounts]:
    """Class -> matches of one image or surface. A prediction more than half void counts for nothing."""
    iou = np.where(table.right_class, table.iou, 0.0)
    match = iou > MIN_IOU
    things = {t.classes[0]: t.is_thing for t in table.truth}
    counts: dict[str, ClassCounts] = {}
    for t, row in enumerate(match):
        name = table.truth[t].classes[0]
        found = ClassCounts(
            is_thing=things[name], tp=int(row.any()), fn=int(not row.any()), iou=float(iou[t][row].sum())
        )
        _add(counts, name, found)
    wrong = ~match.any(axis=0) & (table.void_area <= table.predicted_area)
    for p in np.flatnonzero(wrong):
        name = table.predicted[p].name
        _add(counts, name, ClassCounts(is_thing=things.get(name, _is_thing(name)), fp=1))
    return counts


def panoptic_quality(images: Iterable[Mapping[str, ClassCounts]]) -> PanopticQuality:
    """PQ, RQ and SQ per class over all images, and their means over classes."""
    total: dict[str, ClassCounts] = {}
    for image in images:
        for name, counts in image.items():
            _add(total, name, counts)
    return PanopticQuality(
        all=_means(total.values()),
        things=_means(c for c in total.values() if c.is_thing),
        stuff=_means(c for c in total.values() if not c.is_thing),
        classes=len(total),
        classes_without_truth=sum(c.tp + c.fn == 0 for c in total.values()),
        per_class=dict(sorted(total.items())),
    )


def _add(counts: dict[str, ClassCounts], name: str, more: ClassCounts) -> None:
    counts[name] = counts[name] + more if name in counts else more


def _is_thing(name: str) -> bool:
    category = category_by_name().get(name)
    return category is None or category.is_thing


def _means(classes: Iterable[ClassCounts]) -> QualityMeans:
    found = list(classes)
    if not found:
        return QualityMeans(pq=None, rq=None, sq=None)
    pq, rq, sq = np.mean([(c.pq, c.rq, c.sq) for c in found], axis=0).tolist()
    return QualityMeans(pq=pq, rq=rq, sq=sq)
