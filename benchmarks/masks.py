"""Mean mask IoU of the geometric masks against ground truth, from true boxes and from detected ones, and their cost.

    python benchmarks/masks.py SEQUENCE [--every N]

Only things of at least 1500 visible pixels count. A detected box is matched to the true box with the highest IoU, from
0.5 on, whatever its class. The bare box is the baseline.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm import Frame, InputError, open_sequence
from uppm.core.config import PerceptionConfig
from uppm.perception.registry import create_detector, create_mask_generator, create_segmenter
from uppm.perception.segmentation.gravity import estimate_gravity
from uppm.perception.segmentation.structure import find_structure
from uppm.perception.segmentation.surfaces import surfaces

MIN_PIXELS = 1500
MIN_BOX_IOU = 0.5
Mask = npt.NDArray[np.bool_]


def things(frame: Frame) -> dict[int, Mask]:
    """Instance -> mask of the frame's large enough things."""
    if frame.truth is None:
        raise InputError(f"frame {frame.index}", expected="ground truth", found="none", advice="give another sequence")
    ids, counts = np.unique(frame.truth.instance, return_counts=True)
    large = [int(i) for i, n in zip(ids, counts, strict=True) if n >= MIN_PIXELS and int(i) in frame.truth.things]
    return {i: frame.truth.instance == i for i in large}


def box_of(mask: Mask) -> npt.NDArray[np.float32]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float32)


def box_iou(box: npt.NDArray[np.float32], others: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    sides = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    shared = np.prod(np.maximum(sides, 0), axis=1)
    return shared / (np.prod(box[2:] - box[:2]) + np.prod(others[:, 2:] - others[:, :2], axis=1) - shared)


def iou(a: Mask, b: Mask) -> float:
    return np.count_nonzero(a & b) / max(np.count_nonzero(a | b), 1)


class Measured:
    """IoU by category, kind of box and generator; seconds by stage."""

    def __init__(self) -> None:
        self.values: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
        self.seconds: dict[str, list[float]] = defaultdict(list)
        config = PerceptionConfig()
        self.detector = create_detector(config)
        self.generators = {name: create_mask_generator(PerceptionConfig(masks=name)) for name in ("box", "geometric")}

    def add(self, frame: Frame) -> None:
        true = things(frame)
        if not true or frame.truth is None:
            return
        names = [frame.truth.names[i] for i in true]
        boxes = np.stack([box_of(mask) for mask in true.values()])
        self._compare("true", frame, list(true.values()), names, boxes)
        found = self.detector.detect(frame.color, ()).boxes
        matches = [(int(box_iou(b, boxes).argmax()), b) for b in found if box_iou(b, boxes).max() >= MIN_BOX_IOU]
        masks = [list(true.values())[i] for i, _ in matches]
        if matches:
            self._compare("detected", frame, masks, [names[i] for i, _ in matches], np.stack([b for _, b in matches]))

    def _compare(
        self, kind: str, frame: Frame, true: list[Mask], names: list[str], boxes: npt.NDArray[np.float32]
    ) -> None:
        for generator, masks in self.generators.items():
            for name, mask, truth in zip(names, masks.masks(frame, boxes), true, strict=True):
                self.values[name][f"{kind} {generator}"].append(iou(mask, truth))

    def table(self) -> Iterator[str]:
        columns = ("true box", "true geometric", "detected box", "detected geometric")
        yield f"{'category':18s} {'n':>4s} {'bare':>6s} {'mask':>6s} {'found':>6s} {'bare':>6s} {'mask':>6s}"
        everything: dict[str, list[float]] = defaultdict(list)
        for name, by_kind in sorted(self.values.items()):
            for column, values in by_kind.items():
                everything[column] += values
            yield self._row(name, by_kind, columns)
        yield self._row("all", everything, columns)

    @staticmethod
    def _row(name: str, by_kind: dict[str, list[float]], columns: tuple[str, ...]) -> str:
        cells = [f"{np.mean(by_kind[c]):6.3f}" if by_kind[c] else "     -" for c in columns]
        counts = [len(by_kind[c]) for c in columns[::2]]
        return f"{name:18s} {counts[0]:4d} {cells[0]} {cells[1]} {counts[1]:6d} {cells[2]} {cells[3]}"


def time_stages(frames: list[Frame], seconds: dict[str, list[float]]) -> None:
    """Milliseconds of each stage of the profile `embedded`."""
    config = PerceptionConfig()
    detector, masks, segmenter = create_detector(config), create_mask_generator(config), create_segmenter(config)
    segmenter.prepare(frames[:: max(1, len(frames) // 12)])
    gravity = estimate_gravity(frames[:: max(1, len(frames) // 12)])
    for frame in frames:
        marks = [time.perf_counter()]
        found = detector.detect(frame.color, ())
        marks.append(time.perf_counter())
        surfaces.cache_clear()
        surfaces(frame)
        marks.append(time.perf_counter())
        masks.masks(frame, found.boxes)
        marks.append(time.perf_counter())
        find_structure(frame, gravity)
        marks.append(time.perf_counter())
        for stage, spent in zip(("detector", "surfaces", "masks", "structure"), np.diff(marks), strict=True):
            seconds[stage].append(1e3 * float(spent))
        surfaces.cache_clear()
        start = time.perf_counter()
        segmenter.segment(frame, ())
        seconds["whole profile"].append(1e3 * (time.perf_counter() - start))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--every", type=int, default=5, help="use every n-th frame")
    arguments = parser.parse_args()
    source = open_sequence(arguments.sequence)
    measured, timed = Measured(), []
    for index in range(0, len(source), arguments.every):
        frame = source.frame(index)
        measured.add(frame)
        if len(timed) < 24:
            timed.append(frame)
    print("mean mask IoU; left: true boxes, right: detected boxes")
    print("\n".join(measured.table()))
    time_stages(timed, measured.seconds)
    print(f"\nms a frame over {len(timed)} frames, {platform.machine()}, 2 threads: least, median")
    for stage, values in measured.seconds.items():
        print(f"{stage:18s} {min(values):7.1f} {np.median(values):7.1f}")


if __name__ == "__main__":
    main()
