"""Perception as a whole: labels (VLFE++), segments (OVPS), categories (SR) of one frame; what fusion takes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from threading import RLock

import numpy as np

from uppm.core.config import PerceptionConfig
from uppm.core.errors import BadFrameError
from uppm.core.nulls import Timer
from uppm.core.parallel import exclusive
from uppm.core.protocols import Closable, FrameSource, Labeler, Retriever, Segmenter
from uppm.core.types import DescribedSegmentation, Frame
from uppm.perception.describe import describe
from uppm.perception.keyframes import KeyframePolicy
from uppm.perception.sharpness import SharpnessJudge

PREPARE_FRAMES = 12
"""Frames spread over a sequence that perception may look at before mapping."""
NOT_SHARP = "less sharp than the sequence's other frames"


@dataclass(frozen=True, kw_only=True, eq=False)
class Percept:
    """What perception says of one frame."""

    segmentation: DescribedSegmentation | None = None
    """None between keyframes, whose segments are rendered from the map, and for a frame to skip."""
    skip: str | None = None
    """Reason for which the frame should not be fused."""
    dropped: Mapping[str, int] = field(default_factory=dict[str, int])
    """Reason -> labels, segments or pixels left out."""
    seconds: Mapping[str, float] = field(default_factory=dict[str, float])
    """Stage -> seconds."""


class FrontEnd:
    """Labels, segments and categories of each frame. It never looks at the map, so that it may run ahead of fusion.

    One frame after another, from whatever thread: networks and the choice of keyframes are of one frame at a time.
    """

    def __init__(self, config: PerceptionConfig, labeler: Labeler, segmenter: Segmenter, retriever: Retriever) -> None:
        self.lock = RLock()
        self._labeler, self._segmenter, self._retriever = labeler, segmenter, retriever
        self._sharpness = SharpnessJudge(config.min_sharpness if config.skip_blurry else 0.0)
        self._keyframes = KeyframePolicy(config)

    @exclusive
    def prepare(self, frames: Sequence[Frame]) -> None:
        """Look at a few frames spread over the sequence."""
        self._segmenter.prepare(frames)
        self._sharpness.prepare(frames)

    @exclusive
    def restart(self) -> None:
        """Make the next frame a keyframe: what follows does not depend on the frames before."""
        self._keyframes.restart()

    @exclusive
    def perceive(self, frame: Frame) -> Percept:
        """Everything that fusion needs to know of a frame."""
        timer = Timer()
        with timer("labels"):
            if self._sharpness.is_blurred(frame):
                return Percept(skip=NOT_SHARP)
            if not self._keyframes.choose(frame):
                return Percept(dropped={"frame between keyframes": 1})
            found = self._labeler.label(frame)  # VLFE++, section 3.2.1
        if found.skip:
            self._keyframes.restart()
            return Percept(skip=found.skip, dropped=found.dropped, seconds=timer.seconds)
        with timer("perception"):
            segmentation = self._segmenter.segment(frame, found.labels)  # OVPS, section 3.2.3
        with timer("retrieval"):
            described = describe(segmentation, self._retriever)  # SR, equation 1
        dropped = Counter(found.dropped)
        dropped.update(segmentation.dropped)
        return Percept(segmentation=described, dropped=dropped, seconds=timer.seconds)

    @exclusive
    def close(self) -> None:
        """Release the networks; another frame would load them again."""
        for part in (self._labeler, self._segmenter):
            if isinstance(part, Closable):
                part.close()


def spread_frames(source: FrameSource, count: int = PREPARE_FRAMES) -> list[Frame]:
    """Up to `count` good frames spread evenly over a sequence."""
    frames: list[Frame] = []
    for position in np.unique(np.linspace(0, len(source) - 1, count).astype(int)).tolist():
        with suppress(BadFrameError):
            frames.append(source.frame(position))
    return frames


def good_frames(source: FrameSource) -> Iterator[Frame]:
    """The frames of a sequence that can be used."""
    for position in range(len(source)):
        with suppress(BadFrameError):
            yield source.frame(position)
