"""Segmentation-to-Segmentation: panoptic and semantic metrics of a front end on 2D frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.types import DescribedSegmentation
from uppm.evaluation.average_precision import THRESHOLDS, mean_average_precision
from uppm.evaluation.ground_truth import TruthInstance
from uppm.evaluation.overlaps import Overlaps, PredictedSegment, TrueSegment, overlaps
from uppm.evaluation.panoptic import ClassCounts, count_matches, panoptic_quality
from uppm.evaluation.semantic import semantic_quality


@dataclass(frozen=True, kw_only=True)
class ImagePanopticMetrics:
    """Shares from 0 to 1, over all frames; None where no class has anything to measure."""

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


def frame_overlaps(
    truth_ids: npt.NDArray[np.integer], truth: Mapping[int, TruthInstance], found: DescribedSegmentation
) -> Overlaps:
    """Segments of one frame: the true instance of each pixel (H, W), 0 unknown, and what was found."""
    named = {i: PredictedSegment(name=d.category.name, score=d.score) for i, d in enumerate(found.descriptors, start=1)}
    segments = {i.id: TrueSegment(classes=i.categories, is_thing=i.is_thing) for i in truth.values()}
    return overlaps(truth_ids, found.ids, segments, named)


def image_panoptic_metrics(frames: Sequence[Overlaps]) -> ImagePanopticMetrics:
    """PQ, mAP and mIoU over all frames: counts are added up before they are divided."""
    quality = panoptic_quality(map(count_matches, frames))
    semantic = semantic_quality(frames)
    map_30, map_40, map_50 = (mean_average_precision(frames, threshold) for threshold in THRESHOLDS)
    return ImagePanopticMetrics(
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
