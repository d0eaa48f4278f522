"""The profile `embedded`: detector boxes, masks from depth, structure from planes; no weights to fetch."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from uppm.core.config import PerceptionConfig
from uppm.core.protocols import Detector, MaskGenerator
from uppm.core.types import Frame, Label, PanopticSegmentation, Segment
from uppm.perception.registry import create_detector, create_mask_generator
from uppm.perception.segmentation.assembly import assemble, drop_duplicate_boxes
from uppm.perception.segmentation.gravity import Gravity, estimate_gravity
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
        found, duplicates = drop_duplicate_boxes(self._detector.detect(frame.color, labels))
        masks = self._masks.masks(frame, found.boxes)
        things = [
            (mask, Segment(label=label, score=float(np.clip(score, 0, 1)), is_thing=True))
            for mask, label, score in zip(masks, found.labels, found.scores, strict=True)
        ]
        gravity = self._gravity or estimate_gravity((frame,), self._config.up)
        dropped = Counter({"duplicate_box": duplicates}) if duplicates else None
        return assemble(frame, things + find_structure(frame, gravity), self._config.min_mask_pixels, dropped)
