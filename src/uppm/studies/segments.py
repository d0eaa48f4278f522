"""Panoptic quality of the segments that go into a map, frame by frame (the paper's ablation of suppression)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uppm.core.config import Config
from uppm.evaluation.ground_truth import TruthInstance, load_surface_truth
from uppm.evaluation.overlaps import Overlaps, PredictedSegment, TrueSegment, overlaps
from uppm.evaluation.panoptic import count_matches, panoptic_quality
from uppm.perception.describe import describe
from uppm.perception.registry import create_labeler, create_segmenter, seen_by_camera
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.pipeline import good_frames, open_sequence, spread_frames


def measure_segments(sequence: Path, config: Config) -> dict[str, Any]:
    """PQ, SQ, RQ, and the matched and the missed true segments, over all frames that are not skipped."""
    source = seen_by_camera(open_sequence(sequence, config.input), config.perception)
    truth = load_surface_truth(sequence).instances
    labeler, segmenter = create_labeler(config.perception), create_segmenter(config.perception)
    retriever = create_retriever(config.retrieval, LabelEmbeddings())
    segmenter.prepare(spread_frames(source))
    counts = []
    for frame in good_frames(source):
        told = labeler.label(frame)
        if told.skip or frame.truth is None:
            continue
        segmentation = segmenter.segment(frame, told.labels)
        described = describe(segmentation, retriever)
        found = {
            n: PredictedSegment(name=e.category.name, score=e.score) for n, e in enumerate(described.descriptors, 1)
        }
        counts.append(count_matches(_table(frame.truth.instance, segmentation.ids, truth, found)))
    quality = panoptic_quality(counts)
    classes = quality.per_class.values()
    return {
        "pq": quality.all.pq,
        "sq": quality.all.sq,
        "rq": quality.all.rq,
        "tp": sum(c.tp for c in classes),
        "fn": sum(c.fn for c in classes),
    }


def _table(
    instance: Any, ids: Any, truth: Mapping[int, TruthInstance], found: Mapping[int, PredictedSegment]
) -> Overlaps:
    seen = {i.id: TrueSegment(classes=i.categories, is_thing=i.is_thing) for i in truth.values()}
    return overlaps(instance, ids, seen, found)
