"""The submaps of a map beside the true instances: on the points of the ground truth's surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uppm.evaluation.geometry import THRESHOLD, NearestPoints
from uppm.evaluation.ground_truth import SurfaceTruth
from uppm.evaluation.instances import claimed_submaps
from uppm.evaluation.overlaps import NOTHING, Overlaps, PredictedSegment, TrueSegment, overlaps
from uppm.evaluation.sampling import SurfacePart, SurfaceSamples


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
