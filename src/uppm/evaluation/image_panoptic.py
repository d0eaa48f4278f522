"""The segments of one 2D frame beside its instance image."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from uppm.core.types import DescribedSegmentation
from uppm.evaluation.ground_truth import TruthInstance
from uppm.evaluation.overlaps import Overlaps, PredictedSegment, TrueSegment, overlaps


def frame_overlaps(
    truth_ids: npt.NDArray[np.integer], truth: Mapping[int, TruthInstance], found: DescribedSegmentation
) -> Overlaps:
    """Segments of one frame: the true instance of each pixel (H, W), 0 unknown, and what was found."""
    named = {i: PredictedSegment(name=d.category.name, score=d.score) for i, d in enumerate(found.descriptors, start=1)}
    segments = {i.id: TrueSegment(classes=i.categories, is_thing=i.is_thing) for i in truth.values()}
    return overlaps(truth_ids, found.ids, segments, named)
