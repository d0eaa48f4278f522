"""Perception stage by stage on the device there is, with random weights, beside the paper's table."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uppm.bench.random_models import write_random_model
from uppm.bench.timing import Clock, machine
from uppm.core.categories import unified_categories
from uppm.core.config import Config, PerceptionConfig
from uppm.core.protocols import Closable
from uppm.core.types import Detections, Frame, Intrinsics, Label, PanopticSegmentation, Provenance, Segment
from uppm.fusion.engine import PanopticFusion
from uppm.perception.describe import describe
from uppm.perception.models.network import import_torch
from uppm.perception.models.table import with_needs
from uppm.perception.registry import create_captioner, create_detector, create_mask_generator, models_of
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.perception.segmentation.assembly import assemble
from uppm.perception.segmentation.geometric_masks import BoxMasks
from uppm.perception.segmentation.suppression import suppress
from uppm.pipeline import category_similarity

PAPER_MS = {"labels": 105.0, "retrieval": 8.0, "detector": 120.0, "masks": 180.0, "nms": 2.0, "fusion": 22.8}
"""Per frame on an A100 (paper, table of run times)."""
NOTE = "weights are random: times are those of the real architectures, and captions run to their full length"


@dataclass(frozen=True, kw_only=True)
class PerceptionCase:
    """What is measured."""

    config: PerceptionConfig
    frames: int = 3
    """Timed, after one that is not."""
    labels: int = 12
    """Prompts of the detector."""
    boxes: int = 15
    """Of the mask generator."""
    width: int = 640
    height: int = 480


def bench_perception(case: PerceptionCase) -> dict[str, Any]:
    """Milliseconds of each stage: medians over the frames, one back end in memory at a time."""
    torch = import_torch()
    frame = noise(case)
    labels = [Label(text=c.name, provenance=Provenance.CAPTION) for c in unified_categories()[: case.labels]]
    boxes = random_boxes(case, case.boxes)
    many = crowded(case)
    stages: dict[str, Any] = {}
    load = os.getloadavg()[0]
    with random_weights(models_of(case.config)):
        if case.config.captioner != "none":
            captioner = create_captioner(case.config)
            stages["labels"] = timed(lambda: captioner.caption(frame), case, captioner)
        detector = create_detector(case.config)
        stages["detector"] = timed(lambda: detector.detect(frame.color, labels), case, detector)
        stages["nms"] = timed(lambda: suppress(many, case.config), case, None)
        masks = create_mask_generator(case.config)
        stages["masks"] = timed(lambda: masks.masks(frame, boxes), case, masks)
    stages |= map_stages(frame, boxes, labels, case)
    gpu = torch.cuda.is_available() and case.config.device != "cpu"
    return {
        "profile": case.config.profile,
        "device": torch.cuda.get_device_name() if gpu else "cpu",
        "models": models_of(case.config),
        "frames": case.frames,
        "labels": case.labels,
        "boxes": case.boxes,
        "stages_ms": stages,
        "sum_ms": {clock: round(sum(stage[clock] for stage in stages.values()), 1) for clock in ("wall", "cpu")},
        "paper_ms": PAPER_MS,
        "load_before": round(load, 1),
        "load_after": round(os.getloadavg()[0], 1),
        "machine": machine(),
        "note": NOTE,
    }


def map_stages(frame: Frame, boxes: np.ndarray, labels: Sequence[Label], case: PerceptionCase) -> dict[str, Any]:
    """Retrieval, its labels known to the map, and fusion of the same boxes, seen once more on a wall."""
    known, config = LabelEmbeddings(), Config(perception=case.config)
    retriever = create_retriever(config.retrieval, known)
    found = painted(frame, boxes, labels, case.config)
    fusion = PanopticFusion(config.fusion, category_similarity(known))
    return {
        "retrieval": timed(lambda: describe(found, retriever), case, None),
        "fusion": timed(lambda: fusion.fuse(frame, describe(found, retriever)), case, None),
    }


def painted(frame: Frame, boxes: np.ndarray, labels: Sequence[Label], config: PerceptionConfig) -> PanopticSegmentation:
    """The boxes, whole, as segments that are called by the labels in turn."""
    named = [labels[i % len(labels)] for i in range(len(boxes))]
    segments = [Segment(label=label, score=0.9, is_thing=True) for label in named]
    masks = BoxMasks(config).masks(frame, boxes)
    return assemble(frame, list(zip(masks, segments, strict=True)), config.min_mask_pixels)


@contextmanager
def random_weights(names: Sequence[str]) -> Iterator[None]:
    """`UPPM_MODELS` names a folder of architectures without weights."""
    before = os.environ.get("UPPM_MODELS")
    with tempfile.TemporaryDirectory(prefix="uppm-random-") as folder, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="the weights of .* are random")
        for name in with_needs(list(names)):
            write_random_model(name, Path(folder))
        os.environ["UPPM_MODELS"] = folder
        try:
            yield
        finally:
            os.environ.pop("UPPM_MODELS")
            if before is not None:
                os.environ["UPPM_MODELS"] = before


def timed(run: Callable[[], Any], case: PerceptionCase, part: object) -> dict[str, float]:
    """Median milliseconds, by the wall clock and of processor time; the back end is released after it."""
    run()
    clock = Clock()
    for _ in range(case.frames):
        with clock.frame():
            run()
    if isinstance(part, Closable):
        part.close()
    return {
        "wall": round(1e3 * float(np.median(clock.seconds)), 2),
        "cpu": round(1e3 * float(np.median(clock.cpu_seconds)), 2),
    }


def noise(case: PerceptionCase) -> Frame:
    """A frame of noise."""
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (case.height, case.width, 3)).astype(np.uint8)
    depth = np.full((case.height, case.width), 2, dtype=np.float32)
    cx, cy = (case.width - 1) / 2, (case.height - 1) / 2
    k = Intrinsics(fx=case.width, fy=case.width, cx=cx, cy=cy, width=case.width, height=case.height)
    return Frame(index=0, stamp=0, color=color, depth=depth, T_map_camera=np.eye(4), intrinsics=k)


def random_boxes(case: PerceptionCase, count: int) -> np.ndarray:
    """(count, 4): boxes of 20 to 120 pixels a side."""
    rng = np.random.default_rng(1)
    corner = rng.uniform(0, 1, (count, 2)) * (case.width - 120, case.height - 120)
    return np.concatenate([corner, corner + rng.uniform(20, 120, (count, 2))], axis=1).astype(np.float32)


def crowded(case: PerceptionCase) -> Detections:
    """Three hundred boxes, as many as suppression is meant for at most."""
    names = tuple(Label(text=f"thing {i % 20}", provenance=Provenance.CAPTION) for i in range(300))
    scores = np.linspace(1, 0.3, 300, dtype=np.float32)
    return Detections(boxes=random_boxes(case, 300), scores=scores, labels=names)
