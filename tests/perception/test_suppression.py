"""Non-maximum suppression: the paper's, the classic one, and none; against cases by hand and a slow reference."""

from __future__ import annotations

import time
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uppm.core.config import PerceptionConfig
from uppm.core.types import Detections, Label, Provenance
from uppm.perception.segmentation.suppression import box_iou, classic, custom, label_codes, suppress

CAPTION, TAG = Provenance.CAPTION, Provenance.TAG
Row = tuple[tuple[float, float, float, float], float, str, Provenance]


def detections(*rows: Row) -> Detections:
    return Detections(
        boxes=np.array([row[0] for row in rows], dtype=np.float32).reshape(-1, 4),
        scores=np.array([row[1] for row in rows], dtype=np.float32),
        labels=tuple(Label(text=text, provenance=provenance) for _, _, text, provenance in rows),
    )


def shifted(dx: float, dy: float = 0.0) -> tuple[float, float, float, float]:
    return 10 + dx, 10 + dy, 50 + dx, 60 + dy


@pytest.mark.parametrize(
    ("rows", "kept", "dropped"),
    [
        ([], [], {}),
        ([(shifted(0), 0.5, "cup", TAG)], [0], {}),
        # The higher score stays, whatever the labels.
        ([(shifted(0), 0.5, "cup", TAG), (shifted(1.5), 0.6, "mug", TAG)], [1], {"near_duplicate_box": 1}),
        # The caption's stays though its score is lower.
        ([(shifted(0), 0.5, "cup", CAPTION), (shifted(1), 0.6, "mug", TAG)], [0], {"near_duplicate_box": 1}),
        ([(shifted(0), 0.6, "cup", TAG), (shifted(1), 0.5, "mug", CAPTION)], [1], {"near_duplicate_box": 1}),
        ([(shifted(0), 0.5, "cup", CAPTION), (shifted(1), 0.6, "mug", CAPTION)], [1], {"near_duplicate_box": 1}),
        # Equal in all: the earlier one.
        ([(shifted(0), 0.5, "cup", TAG), (shifted(0), 0.5, "mug", TAG)], [0], {"near_duplicate_box": 1}),
        # One coordinate of eight is too far.
        ([(shifted(0), 0.5, "cup", TAG), (shifted(0, 1.75), 0.6, "mug", TAG)], [0, 1], {}),
        # A chain: the middle one goes for the first, and the last has no duplicate left.
        (
            [(shifted(0), 0.9, "a", TAG), (shifted(1.25), 0.8, "b", TAG), (shifted(2.5), 0.7, "c", TAG)],
            [0, 2], {"near_duplicate_box": 1},
        ),
        # A chain whose best is in the middle: both ends go.
        (
            [(shifted(0), 0.7, "a", TAG), (shifted(1.25), 0.9, "b", TAG), (shifted(2.5), 0.8, "c", TAG)],
            [1], {"near_duplicate_box": 2},
        ),
        # The inner box of one label goes though its score is higher; that of another label stays.
        (
            [((0, 0, 90, 90), 0.4, "chair", TAG), ((20, 20, 40, 40), 0.9, "chair", CAPTION)],
            [0], {"contained_box": 1},
        ),
        ([((0, 0, 90, 90), 0.4, "chair", TAG), ((20, 20, 40, 40), 0.9, "cushion", TAG)], [0, 1], {}),
        # Contained with a common edge; contained twice over.
        (
            [((0, 0, 90, 90), 0.4, "x", TAG), ((0, 0, 60, 90), 0.5, "x", TAG), ((0, 0, 30, 90), 0.6, "x", TAG)],
            [0], {"contained_box": 2},
        ),
        # Overlapping without containment: both stay.
        ([((0, 0, 60, 60), 0.4, "x", TAG), ((1, 20, 61, 80), 0.5, "x", TAG)], [0, 1], {}),
        # Duplicates first: the outer box is dropped as one, so that the inner one has nothing around it.
        (
            [((0, 0, 90, 90), 0.4, "x", TAG), ((1, 1, 91, 91), 0.9, "y", TAG), ((20, 20, 40, 40), 0.5, "x", TAG)],
            [1, 2], {"near_duplicate_box": 1},
        ),
    ],
)  # fmt: skip
def test_custom_on_cases_by_hand(rows: list[Row], kept: list[int], dropped: dict[str, int]) -> None:
    keep, counts = custom(detections(*rows))
    assert keep.tolist() == kept
    assert counts == dropped


@st.composite
def some_detections(draw: st.DrawFn) -> Detections:
    """Boxes on a coarse grid, so that duplicates, containment and ties abound."""
    corner = st.integers(0, 6).map(float)
    row = st.tuples(
        st.tuples(corner, corner, corner.map(lambda v: v + 5), corner.map(lambda v: v + 5)),
        st.sampled_from([0.3, 0.5, 0.9]),
        st.sampled_from(["a", "b"]),
        st.sampled_from([CAPTION, TAG]),
    )
    return detections(*draw(st.lists(row, max_size=12)))


def by_loops(found: Detections) -> list[int]:
    """The paper's rules, one box after another."""
    order = sorted(
        range(len(found.labels)), key=lambda i: (found.labels[i].provenance is not CAPTION, -found.scores[i], i)
    )
    unique: list[int] = []
    for i in order:
        if all(np.abs(found.boxes[i] - found.boxes[k]).max() > 1.5 for k in unique):
            unique.append(i)
    kept = []
    for i in unique:
        a, around = found.boxes[i], [k for k in unique if k != i and found.labels[k].text == found.labels[i].text]
        boxes = [found.boxes[k] for k in around]
        if not any(b[0] <= a[0] and b[1] <= a[1] and a[2] <= b[2] and a[3] <= b[3] for b in boxes):
            kept.append(i)
    return sorted(kept)


@settings(max_examples=150, deadline=None)
@given(some_detections())
def test_custom_agrees_with_loops_and_is_idempotent(found: Detections) -> None:
    keep, dropped = custom(found)
    assert keep.tolist() == by_loops(found)
    assert len(keep) + sum(dropped.values()) == len(found.labels)
    again, none = custom(select(found, keep))
    assert again.tolist() == list(range(len(keep)))
    assert none == {}


@settings(max_examples=100, deadline=None)
@given(some_detections(), st.sampled_from([0.2, 0.5, 0.7]))
def test_classic_agrees_with_loops_and_is_idempotent(found: Detections, limit: float) -> None:
    codes = label_codes(found.labels)
    keep = classic(found.boxes, found.scores, codes, limit)
    expected: list[int] = []
    for i in sorted(range(len(codes)), key=lambda i: (-found.scores[i], i)):
        others = [k for k in expected if codes[k] == codes[i]]
        if all(box_iou(found.boxes[i : i + 1], found.boxes[k : k + 1])[0, 0] <= limit for k in others):
            expected.append(i)
    assert keep.tolist() == expected
    assert classic(found.boxes[keep], found.scores[keep], codes[keep], limit).tolist() == list(range(len(keep)))


def select(found: Detections, keep: np.ndarray) -> Detections:
    labels = tuple(found.labels[i] for i in keep)
    return Detections(boxes=found.boxes[keep], scores=found.scores[keep], labels=labels)


@pytest.mark.parametrize(
    ("nms", "kept", "dropped"),
    [
        ("custom", [0, 2], {"contained_box": 1}),
        ("classic", [0, 1], {"overlapping_box": 1}),
        ("none", [0, 1, 2], {}),
    ],
)
def test_the_setting_chooses(nms: Literal["custom", "classic", "none"], kept: list[int], dropped: dict) -> None:
    found = detections(
        ((0, 0, 90, 90), 0.9, "x", TAG), ((0, 0, 30, 30), 0.5, "x", TAG), ((2, 0, 92, 90), 0.4, "x", TAG)
    )
    keep, counts = suppress(found, PerceptionConfig(nms=nms))
    assert (keep.tolist(), counts) == (kept, dropped)


def test_iou_by_hand() -> None:
    a = np.array([[0, 0, 10, 10], [5, 5, 5, 5]], dtype=np.float32)
    b = np.array([[5, 0, 15, 10], [20, 20, 30, 30], [0, 0, 10, 10]], dtype=np.float32)
    np.testing.assert_allclose(box_iou(a, b), [[1 / 3, 0, 1], [0, 0, 0]], atol=1e-6)


@pytest.mark.parametrize("method", ["custom", "classic"])
def test_three_hundred_boxes_take_a_millisecond_or_less(method: Literal["custom", "classic"]) -> None:
    """Processor time, the least of twenty runs, on the worst case: one chain of duplicates through all boxes."""
    low = np.repeat(np.arange(300, dtype=np.float32)[:, None], 4, axis=1)
    boxes = low + np.array([0, 0, 40, 40], dtype=np.float32)
    labels = tuple(Label(text=f"label {i % 20}", provenance=TAG) for i in range(300))
    found = Detections(boxes=boxes, scores=np.linspace(0.9, 0.3, 300, dtype=np.float32), labels=labels)
    config, least = PerceptionConfig(nms=method), np.inf
    for _ in range(20):
        start = time.process_time()
        suppress(found, config)
        least = min(least, time.process_time() - start)
    assert least <= 1e-3
