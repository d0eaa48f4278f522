"""Segmentation-to-Segmentation: front ends on 2D frames, without any fusion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from contextlib import closing
from dataclasses import asdict
from typing import Any

from uppm.core.config import Config
from uppm.core.errors import InputError
from uppm.core.nulls import Timer
from uppm.core.protocols import Closable, FrameSource
from uppm.core.types import DescribedSegmentation, Frame
from uppm.evaluation.ground_truth import TruthInstance
from uppm.evaluation.image_panoptic import frame_overlaps
from uppm.evaluation.panoptic_metrics import panoptic_metrics
from uppm.perception.describe import describe
from uppm.perception.registry import create_labeler, create_segmenter, seen_by_camera
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.pipeline import good_frames, spread_frames
from uppm.regimes.sequence import speed


class FrontEnd:
    """Labels, segments and categories of a frame: what the mapper does before it fuses."""

    def __init__(self, config: Config) -> None:
        self._labeler, self._segmenter = create_labeler(config.perception), create_segmenter(config.perception)
        self._retriever = create_retriever(config.retrieval, LabelEmbeddings())
        self.timer = Timer()
        self.skipped = Counter[str]()
        """Reason -> frames that perception judged unfit."""

    def prepare(self, frames: list[Frame]) -> None:
        """Let perception look at a few frames first."""
        self._segmenter.prepare(frames)

    def perceive(self, frame: Frame) -> DescribedSegmentation | None:
        """The segments of one frame; None where it was judged unfit."""
        with self.timer("labels"):
            found = self._labeler.label(frame)
        if found.skip:
            self.skipped[found.skip] += 1
            return None
        with self.timer("perception"):
            segmentation = self._segmenter.segment(frame, found.labels)
        with self.timer("retrieval"):
            return describe(segmentation, self._retriever)

    def close(self) -> None:
        """Release the networks."""
        for part in (self._labeler, self._segmenter):
            if isinstance(part, Closable):
                part.close()


def evaluate_segmenter(source: FrameSource, truth: Mapping[int, TruthInstance], config: Config) -> dict[str, Any]:
    """Segment every frame that has ground truth and measure the segments against its instance image.

    Raises
    ------
    InputError
        No frame has ground truth.
    """
    tables, source = [], seen_by_camera(source, config.perception)
    with closing(FrontEnd(config)) as front_end:
        front_end.prepare(spread_frames(source))
        for frame in good_frames(source):
            found = front_end.perceive(frame) if frame.truth is not None else None
            if frame.truth is not None and found is not None:
                tables.append(frame_overlaps(frame.truth.instance, truth, found))
    if not tables:
        advice = "give a sequence with instance images (docs/datasets.md)"
        raise InputError(source.name, expected="frames with ground truth", found="none", advice=advice)
    return {
        "sequence": source.name,
        "perception": config.perception.profile,
        **asdict(panoptic_metrics(tables)),
        **speed(front_end.timer.seconds, len(tables)),
        "skipped": front_end.skipped.total(),
    }
