"""Panoptic and semantic metrics of a map in 3D: on the points of the ground truth's surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uppm.evaluation.average_precision import THRESHOLDS, mean_average_precision
from uppm.evaluation.geometry import THRESHOLD, NearestPoints
from uppm.evaluation.ground_truth import SurfaceTruth
from uppm.evaluation.instances import claimed_submaps
from uppm.evaluation.overlaps import NOTHING, Overlaps, PredictedSegment, TrueSegment, overlaps
from uppm.evaluation.panoptic import ClassCounts, count_matches, panoptic_quality
from uppm.evaluation.sampling import SurfacePart, SurfaceSamples
from uppm.evaluation.semantic import semantic_quality


@dataclass(frozen=True, kw_only=True)
class SurfacePanopticMetrics:
    """Shares from 0 to 1; None where no class has anything to measure."""

    pq_3d: float | None
    rq_3d: float | None
    sq_3d: float | None
    pq_3d_things: float | None
    rq_3d_things: float | None
    sq_3d_things: float | None
    pq_3d_stuff: float | None
    rq_3d_stuff: float | None
    sq_3d_stuff: float | None
    map_30: float | None
    map_40: float | None
    map_50: float | None
    miou: float | None
    fw_iou: float | None
    classes: int
    classes_without_truth: int
    classes_excluded: int
    """Classes that the ground truth names and has no point of: in no mean."""
    per_class: dict[str, ClassCounts]


def surface_overlaps(
    parts: Sequence[SurfacePart], samples: SurfaceSamples, nearest: NearestPoints, truth: SurfaceTruth
) -> Overlaps:
    """Segments on the points of G, each of the submap of its nearest point of R within 5 cm.

    Points of R with no point of G within 5 cm are further elements, where the truth is nothing: what is reconstructed
    where no surface is makes its submap larger, and alone is a false positive.
    """
    lone = samples.part[nearest.to_truth > THRESHOLD]
    return overlaps(
        np.concatenate([truth.instance, np.full(len(lone), NOTHING)]),
        np.concatenate([claimed_submaps(samples, nearest), lone]),
        {i.id: TrueSegment(classes=i.categories, is_thing=i.is_thing) for i in truth.instances.values()},
        {part.id: PredictedSegment(name=part.category or "unlabeled", score=part.score) for part in parts},
    )


def surface_panoptic_metrics(table: Overlaps, truth: SurfaceTruth) -> SurfacePanopticMetrics:
    """PQ, mAP and mIoU of one map."""
    quality = panoptic_quality([count_matches(table)])
    semantic = semantic_quality([table])
    map_30, map_40, map_50 = (mean_average_precision([table], threshold) for threshold in THRESHOLDS)
    return SurfacePanopticMetrics(
        pq_3d=quality.all.pq,
        rq_3d=quality.all.rq,
        sq_3d=quality.all.sq,
        pq_3d_things=quality.things.pq,
        rq_3d_things=quality.things.rq,
        sq_3d_things=quality.things.sq,
        pq_3d_stuff=quality.stuff.pq,
        rq_3d_stuff=quality.stuff.rq,
        sq_3d_stuff=quality.stuff.sq,
        map_30=map_30,
        map_40=map_40,
        map_50=map_50,
        miou=semantic.miou,
        fw_iou=semantic.fw_iou,
        classes=quality.classes,
        classes_without_truth=quality.classes_without_truth,
        classes_excluded=len(truth.classes_without_points),
        per_class=dict(quality.per_class),
    )
