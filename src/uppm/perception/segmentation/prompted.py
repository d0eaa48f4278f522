"""The profile `foundation`: boxes for an image's labels, a mask for each, one id image (paper section 3.2.3)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from uppm.core.categories import unified_categories
from uppm.core.config import PerceptionConfig
from uppm.core.protocols import Closable, Detector, MaskGenerator
from uppm.core.types import Detections, Frame, Label, PanopticSegmentation, Segment
from uppm.perception.registry import create_detector, create_mask_generator
from uppm.perception.segmentation.assembly import assemble
from uppm.perception.segmentation.depth_edges import cut_at_steps, cuts
from uppm.perception.segmentation.suppression import suppress

SURFACES = ("floor", "ceiling", "wall", "ground", "sky", "water")
"""Supercategories of COCO-Stuff that nobody counts. Its stuff also holds cabinets, doors and pillows, which are things
to a map."""


class PromptedSegmenter:
    """Open-vocabulary panoptic segmentation: detect, suppress, mask, cut, assemble. Each frame stands for itself."""

    def __init__(
        self, config: PerceptionConfig, detector: Detector | None = None, masks: MaskGenerator | None = None
    ) -> None:
        self._config = config
        self._detector = detector or create_detector(config)
        self._masks = masks or create_mask_generator(config)

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Nothing to learn from the sequence."""

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        """The segments of the frame that its labels name."""
        found = self._detector.detect(frame.color, labels)
        from_depth = self._config.masks == "geometric"
        return assembled(
            frame,
            self._config,
            found,
            lambda keep: self._masks.masks(frame, found.boxes[keep]),
            from_depth=from_depth,
        )

    def close(self) -> None:
        """Release what the back ends hold."""
        for part in (self._detector, self._masks):
            if isinstance(part, Closable):
                part.close()


def assembled(
    frame: Frame,
    config: PerceptionConfig,
    found: Detections,
    masks_of: Callable[[npt.NDArray[np.intp]], npt.NDArray[np.bool_]],
    *,
    from_depth: bool = False,
) -> PanopticSegmentation:
    """Suppression, masks (K, H, W) of the boxes that stay, depth edges, one id image."""
    keep, dropped = suppress(found, config)
    masks, leaked = masks_of(keep), 0
    if cuts(config, from_depth=from_depth):
        masks, leaked = cut_at_steps(frame, masks)
    segments = [
        Segment(label=label, score=float(np.clip(score, 0, 1)), is_thing=not is_surface(label.text))
        for label, score in ((found.labels[i], found.scores[i]) for i in keep)
    ]
    candidates = list(zip(masks, segments, strict=True))
    return assemble(frame, candidates, config.min_mask_pixels, dropped + Counter(leaked_pixels=leaked))


def is_surface(text: str) -> bool:
    """Whether a label names a stretch of background: its head noun is a floor, a wall, grass, the sky."""
    words = text.lower().split()
    return bool(words) and words[-1] in _SURFACE_NOUNS


_SURFACE_NOUNS = {c.name.split("-")[0] for c in unified_categories() if c.supercategory in SURFACES} | {"grass"}
