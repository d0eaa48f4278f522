"""Masks without a learned model: the surface patches that lie in a box (design of the profile `embedded`)."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame
from uppm.perception.segmentation.surfaces import Surfaces, surfaces

INSIDE = 0.75
"""A patch with at least this share of its pixels in the box is the object's."""


class GeometricMasks:
    """MaskGenerator on depth and colour."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config

    def masks(self, frame: Frame, boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """One mask a box: (N, H, W)."""
        surface = surfaces(frame)
        height, width = frame.depth.shape
        out = np.zeros((len(boxes), height, width), dtype=bool)
        for mask, box in zip(out, boxes, strict=True):
            x0, y0, x1, y1 = (int(v) for v in np.round(box))
            small = patches_inside(surface, box / surface.scale)
            full = cv2.resize(small.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
            mask[y0:y1, x0:x1] = full[y0:y1, x0:x1] > 0
        return out


def patches_inside(surface: Surfaces, box: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Mask (h, w) of the patches that lie mostly in the box (reduced pixels)."""
    x0, y0, x1, y1 = (int(v) for v in np.round(box))
    total = np.bincount(surface.patches.ravel(), minlength=surface.count + 1)
    inside = np.bincount(surface.patches[y0:y1, x0:x1].ravel(), minlength=surface.count + 1)
    chosen = inside > INSIDE * np.maximum(total, 1)
    return chosen[surface.patches]


class BoxMasks:
    """MaskGenerator that takes the whole box: the baseline."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config

    def masks(self, frame: Frame, boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """One mask a box: (N, H, W)."""
        out = np.zeros((len(boxes), *frame.depth.shape), dtype=bool)
        for mask, box in zip(out, boxes, strict=True):
            x0, y0, x1, y1 = (int(v) for v in np.round(box))
            mask[y0:y1, x0:x1] = True
        return out
