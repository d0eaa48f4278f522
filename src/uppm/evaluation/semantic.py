"""Mean and frequency-weighted IoU of classes, on images or on points."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from uppm.evaluation.overlaps import Overlaps


@dataclass(frozen=True, kw_only=True)
class SemanticQuality:
    """Over the classes of the truth; None without any."""

    miou: float | None
    fw_iou: float | None
    """Weighted by each class's share of the true elements."""


def semantic_quality(tables: Iterable[Overlaps]) -> SemanticQuality:
    """IoU of each class over all images: a right class in any segment is right; void does not count."""
    hits, truth, predicted = Counter[str](), Counter[str](), Counter[str]()
    for table in tables:
        for t, area in zip(table.truth, table.truth_area, strict=True):
            truth[t.classes[0]] += int(area)
        outside = table.predicted_area - table.intersection.sum(axis=0)
        for p, area in zip(table.predicted, outside, strict=True):
            predicted[p.name] += int(area)
        right_class = table.right_class
        for t, p in np.argwhere(table.intersection):
            right = right_class[t, p]
            name = table.truth[t].classes[0] if right else table.predicted[p].name
            predicted[name] += int(table.intersection[t, p])
            hits[name] += int(table.intersection[t, p]) if right else 0
    iou = {name: hits[name] / (truth[name] + predicted[name] - hits[name]) for name in truth}
    if not iou:
        return SemanticQuality(miou=None, fw_iou=None)
    weighted = sum(truth[name] * value for name, value in iou.items()) / truth.total()
    return SemanticQuality(miou=float(np.mean(list(iou.values()))), fw_iou=weighted)
