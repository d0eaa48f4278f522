"""What cutting masks at depth steps does to panoptic quality: masks that leak by a known amount, and the profile's own.

    python benchmarks/depth_edges.py SEQUENCE [--every N]

Leaks are simulated on the ground truth's things, seeded by the frame: `grown` masks by 2, 5 or 9 pixels, `blobs` of a
tenth to a third of the mask's side on its outline, `both`; `perfect` masks show what the cut costs where there is
nothing to cut. `geometric` and `box` are the masks of detected boxes of the profile `embedded`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from uppm import Frame, open_sequence
from uppm.core.config import PerceptionConfig
from uppm.core.types import Label, PanopticSegmentation, Provenance, Segment
from uppm.evaluation.ground_truth import TruthInstance, load_surface_truth
from uppm.evaluation.overlaps import PredictedSegment, TrueSegment, overlaps
from uppm.evaluation.panoptic import ClassCounts, count_matches, panoptic_quality
from uppm.perception.registry import create_segmenter
from uppm.perception.segmentation.assembly import Mask, assemble
from uppm.perception.segmentation.depth_edges import cut_at_steps

GROWTH = (2, 5, 9)
MIN_PIXELS = 300
KINDS = ("perfect", "grown", "blobs", "both")
Candidates = list[tuple[Mask, Segment]]


def leaky(mask: Mask, kind: str, rng: np.random.Generator) -> Mask:
    out, growth = mask.astype(np.uint8), int(rng.choice(GROWTH))
    if kind in ("grown", "both"):
        out = cv2.dilate(out, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * growth + 1, 2 * growth + 1)))
    if kind in ("blobs", "both"):
        outline = np.argwhere(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)))
        for y, x in outline[rng.integers(len(outline), size=int(rng.integers(1, 4)))].tolist():
            radius = max(3, int(rng.uniform(0.1, 0.35) * np.sqrt(np.count_nonzero(mask))))
            cv2.circle(out, (x, y), radius, 1, -1)
    return out > 0


def simulated(frame: Frame, known: Mapping[int, TruthInstance], kind: str) -> Candidates:
    """The true segments of a frame, with right labels, random scores, and things that leak."""
    assert frame.truth is not None
    rng, out = np.random.default_rng(frame.index), []
    for number, pixels in zip(*np.unique(frame.truth.instance, return_counts=True), strict=True):
        if int(number) not in known or pixels < MIN_PIXELS:
            continue
        row, mask = known[int(number)], frame.truth.instance == number
        label = Label(text=row.categories[0], provenance=Provenance.DETECTOR)
        segment = Segment(label=label, score=float(rng.uniform(0.4, 1)), is_thing=row.is_thing)
        out.append((leaky(mask, kind, rng) if row.is_thing else mask, segment))
    return out


def without_leaks(frame: Frame, candidates: Candidates) -> Candidates:
    things = [i for i, (_, segment) in enumerate(candidates) if segment.is_thing]
    masks = [candidates[i][0] for i in things]
    cut, _ = cut_at_steps(frame, np.array(masks, dtype=bool).reshape(-1, *frame.depth.shape))
    by_index = dict(zip(things, cut, strict=True))
    return [(by_index.get(i, mask), segment) for i, (mask, segment) in enumerate(candidates)]


class Score:
    """Panoptic quality of one way of making segments."""

    def __init__(self, known: Mapping[int, TruthInstance]) -> None:
        self._truth = {n: TrueSegment(classes=row.categories, is_thing=row.is_thing) for n, row in known.items()}
        self._counts: list[dict[str, ClassCounts]] = []

    def add(self, frame: Frame, found: PanopticSegmentation) -> None:
        assert frame.truth is not None
        named = {i: PredictedSegment(name=s.label.text, score=s.score) for i, s in enumerate(found.segments, 1)}
        self._counts.append(count_matches(overlaps(frame.truth.instance, found.ids, self._truth, named)))

    def __str__(self) -> str:
        quality = panoptic_quality(self._counts)
        q = quality.all
        return f"PQ {q.pq or 0:.4f}  RQ {q.rq or 0:.4f}  SQ {q.sq or 0:.4f}  things' PQ {quality.things.pq or 0:.4f}"


def measure_simulated(frames: Sequence[Frame], known: Mapping[int, TruthInstance]) -> None:
    for kind in KINDS:
        scores, seconds, masks = {"keep": Score(known), "cut": Score(known)}, 0.0, 0
        for frame in frames:
            candidates = simulated(frame, known, kind)
            start = time.process_time()
            cut = without_leaks(frame, candidates)
            seconds, masks = seconds + time.process_time() - start, masks + sum(s.is_thing for _, s in candidates)
            for name, some in (("keep", candidates), ("cut", cut)):
                scores[name].add(frame, assemble(frame, some, PerceptionConfig().min_mask_pixels))
        for name, score in scores.items():
            print(f"{kind:10s} {name:5s} {score}")
        print(f"{kind:10s} {1e3 * seconds / max(masks, 1):.2f} ms of processor time a mask")


def measure_embedded(frames: Sequence[Frame], known: Mapping[int, TruthInstance]) -> None:
    for masks in ("geometric", "box"):
        for edges in ("keep", "cut"):
            config = PerceptionConfig.model_validate({"masks": masks, "depth_edges": edges})
            segmenter, score = create_segmenter(config), Score(known)
            segmenter.prepare(frames[:: max(1, len(frames) // 12)])
            for frame in frames:
                score.add(frame, segmenter.segment(frame, ()))
            print(f"{masks:10s} {edges:5s} {score}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--every", type=int, default=6, help="use every n-th frame")
    arguments = parser.parse_args()
    source, known = open_sequence(arguments.sequence), load_surface_truth(arguments.sequence).instances
    frames = [source.frame(i) for i in range(0, len(source), arguments.every)]
    measure_simulated(frames, known)
    measure_embedded(frames, known)


if __name__ == "__main__":
    main()
