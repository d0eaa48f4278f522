"""Segments that cost no perception: a fixed grid, or the sequence's own ground truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from uppm.core.categories import unified_categories
from uppm.core.config import FusionConfig, PerceptionConfig, RetrievalConfig
from uppm.core.types import DescribedSegmentation, ElementaryDescriptor, Frame, Provenance
from uppm.perception.describe import describe
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.perception.segmentation.groundtruth import GroundTruthSegmenter

ROWS, COLUMNS = 2, 4
Segments = Callable[[Frame], DescribedSegmentation]


def grid8(frame: Frame) -> DescribedSegmentation:
    """The image cut into 2 rows and 4 columns, each with a category of its own, so that each has its own submap."""
    height, width = frame.depth.shape
    row = np.arange(height) * ROWS // height
    column = np.arange(width) * COLUMNS // width
    categories = [c for c in unified_categories() if c.is_thing][: ROWS * COLUMNS]
    descriptors = tuple(
        ElementaryDescriptor(label=c.name, category=c, provenance=Provenance.PRECOMPUTED, score=1.0) for c in categories
    )
    ids = (row[:, None] * COLUMNS + column + 1).astype(np.int32)
    return DescribedSegmentation(ids=ids, descriptors=descriptors, is_thing=(True,) * len(descriptors))


def ground_truth() -> Segments:
    """The frame's true instances with the categories that their names are retrieved to."""
    segmenter, retriever = (
        GroundTruthSegmenter(PerceptionConfig()),
        create_retriever(RetrievalConfig(), LabelEmbeddings()),
    )
    return lambda frame: describe(segmenter.segment(frame), retriever)


def segments_of(kind: str) -> Segments:
    """The source of segments by its name, `grid8` or `groundtruth`."""
    return grid8 if kind == "grid8" else ground_truth()


def settings_for(kind: str, fusion: FusionConfig) -> FusionConfig:
    """The fusion's settings with which the segments of this kind keep to their submaps."""
    # A cell of the grid is no object that stays where it is: its submap is the one of its category, wherever it looks,
    # and that its neighbour comes to lie on the same surface is no sign of two objects.
    update = {"category_policy": "same", "min_iou": 0.0, "split_frames": None}
    return fusion.model_copy(update=update) if kind == "grid8" else fusion
