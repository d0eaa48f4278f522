"""The profile `embedded`: detector boxes, masks from depth, structure from planes; no weights to fetch."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from uppm.core.config import PerceptionConfig
from uppm.core.protocols import Detector, MaskGenerator
from uppm.core.types import Frame, Label, PanopticSegmentation, Segment
from uppm.perception.registry import create_detector, create_mask_generator
from uppm.perception.segmentation.assembly import Mask, assemble, distinct_boxes
from uppm.perception.segmentation.depth_edges import cut_at_steps, cuts
from uppm.perception.segmentation.gravity import Gravity, estimate_gravity
from uppm.perception.segmentation.plausible import has_plausible_size, off_the_floor
from uppm.perception.segmentation.structure import find_structure


class EmbeddedSegmenter:
    """Things from boxes and depth, stuff from gravity-aligned planes.

    `prepare` fixes gravity; after it `segment` depends on its arguments alone. Without `prepare` each frame is its own
    reference.
    """

    def __init__(
        self, config: PerceptionConfig, detector: Detector | None = None, masks: MaskGenerator | None = None
    ) -> None:
        self._config = config
        self._detector = detector or create_detector(config)
        self._masks = masks or create_mask_generator(config)
        self._gravity: Gravity | None = None

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Estimate the up axis and the heights of floor and ceiling from 8 to 16 frames spread over the sequence."""
        if frames:
            self._gravity = estimate_gravity(frames, self._config.up)

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        """Panoptic segmentation of one frame (paper section 3.2.3)."""
        structure = find_structure(frame, self._gravity or estimate_gravity((frame,), self._config.up))
        things, dropped = self._things(frame, labels)
        things = [(off_the_floor(mask, structure), segment) for mask, segment in things]
        return assemble(frame, things + structure, self._config.min_mask_pixels, dropped)

    def _things(self, frame: Frame, labels: Sequence[Label]) -> tuple[list[tuple[Mask, Segment]], Counter[str]]:
        found = self._detector.detect(frame.color, labels)
        masks, leaked = self._masks.masks(frame, found.boxes), 0
        if cuts(self._config, from_depth=self._config.masks == "geometric"):
            masks, leaked = cut_at_steps(frame, masks)
        fits = [has_plausible_size(frame, m, label.text) for m, label in zip(masks, found.labels, strict=True)]
        unique = distinct_boxes(found, np.flatnonzero(fits))
        dropped = Counter(
            implausible_size=fits.count(False), duplicate_box=fits.count(True) - len(unique), leaked_pixels=leaked
        )
        things = [
            (masks[i], Segment(label=found.labels[i], score=float(np.clip(found.scores[i], 0, 1)), is_thing=True))
            for i in unique
        ]
        return things, +dropped
