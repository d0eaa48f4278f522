"""The profile `groundtruth`: the sequence's own instance images (the paper's GTS baseline)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uppm.core.config import PerceptionConfig
from uppm.core.errors import InputError
from uppm.core.types import Frame, Label, PanopticSegmentation, Provenance, Segment


class GroundTruthSegmenter:
    """Segments are the instances, with score 1; nothing is dropped."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Nothing to learn from the sequence."""

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        """One segment an instance that the frame shows.

        Raises
        ------
        InputError
            The sequence has no ground truth.
        """
        truth = frame.truth
        if truth is None:
            advice = "use --set perception.profile=embedded, or give the sequence instance/ and labels.csv"
            raise InputError(f"frame {frame.index}", expected="ground truth", found="none", advice=advice)
        instances, inverse = np.unique(truth.instance, return_inverse=True)
        known = np.array([int(i) in truth.names for i in instances])
        ids = np.where(known, np.cumsum(known), 0)[inverse].reshape(truth.instance.shape).astype(np.int32)
        segments = tuple(
            Segment(
                label=Label(text=truth.names[int(i)], provenance=Provenance.GROUND_TRUTH),
                score=1.0,
                is_thing=int(i) in truth.things,
            )
            for i in instances[known]
        )
        unlabeled = int(np.count_nonzero((ids == 0) & (frame.depth > 0)))
        return PanopticSegmentation(ids=ids, segments=segments, dropped={"unlabeled_pixels": unlabeled})
