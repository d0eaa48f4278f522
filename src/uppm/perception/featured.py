"""A front end whose segments also carry how they look (`perception.visual_feature`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from uppm.core.protocols import Closable, Segmenter, VisualEncoder
from uppm.core.types import Frame, Label, PanopticSegmentation

MARGIN = 0.1
"""What is shown around a segment, as a share of its box's sides: such models know things by their place too."""


class WithFeatures:
    """Segmenter around another one."""

    def __init__(self, segmenter: Segmenter, encoder: VisualEncoder) -> None:
        self._segmenter, self._encoder = segmenter, encoder

    def prepare(self, frames: Sequence[Frame]) -> None:
        """As the segmenter does."""
        self._segmenter.prepare(frames)

    def segment(self, frame: Frame, labels: Sequence[Label]) -> PanopticSegmentation:
        """The segmenter's segments, each with the feature of what its box shows."""
        found = self._segmenter.segment(frame, labels)
        if not found.segments:
            return found
        features = self._encoder.encode(frame.color, segment_boxes(found.ids, len(found.segments)))
        segments = (replace(s, feature=f) for s, f in zip(found.segments, features, strict=True))
        return replace(found, segments=tuple(segments))

    def close(self) -> None:
        """Release what both hold."""
        for part in (self._segmenter, self._encoder):
            if isinstance(part, Closable):
                part.close()


def segment_boxes(ids: npt.NDArray[np.int32], count: int) -> npt.NDArray[np.int64]:
    """(count, 4) x0, y0, x1, y1 of each segment with its margin; the whole image for one without pixels."""
    height, width = ids.shape
    boxes = np.tile(np.array([0, 0, width, height], dtype=np.int64), (count, 1))
    for k in range(1, count + 1):
        mask = ids == k
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        if len(rows):
            low, high = np.array([columns[0], rows[0]]), np.array([columns[-1], rows[-1]]) + 1
            margin = np.ceil(MARGIN * (high - low)).astype(np.int64)
            boxes[k - 1, :2] = np.maximum(low - margin, 0)
            boxes[k - 1, 2:] = np.minimum(high + margin, (width, height))
    return boxes
