"""Segmentation-to-Segmentation: front ends on 2D frames, without any fusion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import asdict
from typing import Any

import numpy as np

from uppm.core.config import Config
from uppm.core.errors import BadFrameError, InputError
from uppm.core.nulls import Timer
from uppm.core.protocols import FrameSource
from uppm.core.types import Frame
from uppm.evaluation.ground_truth import TruthInstance
from uppm.evaluation.image_panoptic import frame_overlaps
from uppm.evaluation.overlaps import Overlaps
from uppm.evaluation.panoptic_metrics import panoptic_metrics
from uppm.perception.front_end import FrontEnd, spread_frames
from uppm.perception.registry import create_labeler, create_segmenter, seen_by_camera
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.regimes.frame_pictures import Image, draw_frame
from uppm.regimes.sequence import speed

PICTURED = 3
"""Frames, spread over the sequence, that are drawn."""


def evaluate_segmenter(
    source: FrameSource, truth: Mapping[int, TruthInstance], config: Config
) -> tuple[dict[str, Any], dict[int, Image]]:
    """Segment every frame that has ground truth and measure the segments against its instance image.

    Returns
    -------
    The figures; and by the index of each of a few frames, where its segments are wrong.

    Raises
    ------
    InputError
        No frame has ground truth.
    """
    tables: list[Overlaps] = []
    timer, skipped, pictures = Timer(), 0, dict[int, Image]()
    source = seen_by_camera(source, config.perception)
    drawn = set(np.linspace(0, len(source) - 1, PICTURED + 2).astype(int).tolist()[1:-1])
    with closing(_front_end(config)) as front_end:
        front_end.prepare(spread_frames(source))
        for position, frame in _frames_with_truth(source):
            percept = front_end.perceive(frame)
            timer.add(percept.seconds)
            skipped += percept.skip is not None
            if frame.truth is not None and percept.segmentation is not None:
                tables.append(frame_overlaps(frame.truth.instance, truth, percept.segmentation))
                if position in drawn:
                    pictures[frame.index] = draw_frame(frame, percept.segmentation, truth)
    if not tables:
        advice = "give a sequence with instance images (docs/datasets.md)"
        raise InputError(source.name, expected="frames with ground truth", found="none", advice=advice)
    return {
        "sequence": source.name,
        "perception": config.perception.profile,
        **asdict(panoptic_metrics(tables)),
        **speed(timer.seconds, len(tables)),
        "skipped": skipped,
    }, pictures


def _front_end(config: Config) -> FrontEnd:
    """What the mapper asks before it fuses."""
    perception = config.perception
    retriever = create_retriever(config.retrieval, LabelEmbeddings())
    return FrontEnd(perception, create_labeler(perception), create_segmenter(perception), retriever)


def _frames_with_truth(source: FrameSource) -> Iterator[tuple[int, Frame]]:
    for position in range(len(source)):
        with suppress(BadFrameError):
            frame = source.frame(position)
            if frame.truth is not None:
                yield position, frame
