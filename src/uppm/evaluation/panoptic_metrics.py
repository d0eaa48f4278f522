"""Panoptic and semantic quality as one flat record: of a front end on 2D frames, or of a map on points in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from uppm.evaluation.average_precision import THRESHOLDS, mean_average_precision
from uppm.evaluation.overlaps import Overlaps
from uppm.evaluation.panoptic import ClassCounts, count_matches, panoptic_quality
from uppm.evaluation.semantic import semantic_quality


@dataclass(frozen=True, kw_only=True)
class PanopticMetrics:
    """Shares from 0 to 1; None where no class has anything to measure."""

    pq: float | None
    rq: float | None
    sq: float | None
    pq_things: float | None
    rq_things: float | None
    sq_things: float | None
    pq_stuff: float | None
    rq_stuff: float | None
    sq_stuff: float | None
    map_30: float | None
    map_40: float | None
    map_50: float | None
    miou: float | None
    fw_iou: float | None
    classes: int
    classes_without_truth: int
    per_class: dict[str, ClassCounts]


def panoptic_metrics(tables: Sequence[Overlaps]) -> PanopticMetrics:
    """PQ, mAP and mIoU over frames, or of the one table of a map: counts are added up before they are divided."""
    quality = panoptic_quality(map(count_matches, tables))
    semantic = semantic_quality(tables)
    map_30, map_40, map_50 = (mean_average_precision(tables, threshold) for threshold in THRESHOLDS)
    return PanopticMetrics(
        pq=quality.all.pq,
        rq=quality.all.rq,
        sq=quality.all.sq,
        pq_things=quality.things.pq,
        rq_things=quality.things.rq,
        sq_things=quality.things.sq,
        pq_stuff=quality.stuff.pq,
        rq_stuff=quality.stuff.rq,
        sq_stuff=quality.stuff.sq,
        map_30=map_30,
        map_40=map_40,
        map_50=map_50,
        miou=semantic.miou,
        fw_iou=semantic.fw_iou,
        classes=quality.classes,
        classes_without_truth=quality.classes_without_truth,
        per_class=dict(quality.per_class),
    )
