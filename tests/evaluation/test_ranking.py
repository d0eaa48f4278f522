"""mAP and mIoU."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.evaluation.test_panoptic import row, said, stuff, thing
from uppm.evaluation.average_precision import average_precision, mean_average_precision
from uppm.evaluation.overlaps import PredictedSegment, overlaps
from uppm.evaluation.semantic import semantic_quality


def scored(**segments: tuple[str, float]) -> dict[int, PredictedSegment]:
    return {int(key[1:]): PredictedSegment(name=name, score=score) for key, (name, score) in segments.items()}


def test_area_under_the_curve_by_hand() -> None:
    # Hit, miss, hit, miss of 3: precision 1 at recall 1/3, 2/3 at recall 2/3.
    assert average_precision(np.array([True, False, True, False]), 3) == pytest.approx((1 + 2 / 3) / 3)
    # A miss before two hits of 2: precisions 1/2 and 2/3; the first is raised to the second.
    assert average_precision(np.array([False, True, True]), 2) == pytest.approx(2 / 3)
    assert average_precision(np.array([], dtype=bool), 2) == 0


@settings(max_examples=50, deadline=None)
@given(hits=st.lists(st.booleans(), max_size=30), missed=st.integers(0, 5))
def test_area_agrees_with_a_numeric_integral(hits: list[bool], missed: int) -> None:
    truth = sum(hits) + missed
    if not truth:
        return
    recall = np.cumsum(hits) / truth
    precision = np.cumsum(hits) / np.arange(1, len(hits) + 1)
    steps = (np.arange(truth) + 0.5) / truth
    best = [max((p for p, r in zip(precision, recall, strict=True) if r >= s), default=0.0) for s in steps]
    assert average_precision(np.array(hits, dtype=bool), truth) == pytest.approx(np.mean(best))


def test_thresholds_duplicates_and_ranking() -> None:
    truth = {1: thing("cup"), 2: thing("bowl")}
    # On the cup: IoU 0.45 at score 0.9, and 0.35 at 0.5; nothing on the bowl.
    table = overlaps(row(_1=20, _2=10), row(_1=9, _2=7, _0=14), truth, scored(_1=("cup", 0.9), _2=("cup", 0.5)))
    assert mean_average_precision([table], 0.3) == pytest.approx(0.5)
    assert mean_average_precision([table], 0.4) == pytest.approx(0.5)
    assert mean_average_precision([table], 0.5) == 0
    # The better ranked one only passes the lower threshold: at 0.4 it is a miss before the hit.
    other = overlaps(row(_1=20, _2=10), row(_1=7, _2=9, _0=14), truth, scored(_1=("cup", 0.9), _2=("cup", 0.5)))
    assert mean_average_precision([other], 0.3) == pytest.approx(0.5)
    assert mean_average_precision([other], 0.4) == pytest.approx(0.25)


def test_ranking_runs_over_all_images() -> None:
    hit = overlaps(row(_1=4, _2=4), row(_1=4, _0=4), {1: thing("cup"), 2: stuff("floor-wood")}, scored(_1=("cup", 0.3)))
    miss = overlaps(row(_2=4, _3=4), row(_0=4, _1=4), {2: thing("cup"), 3: thing("bowl")}, scored(_1=("cup", 0.8)))
    # Cup: miss (0.8), hit (0.3) of 2: 1/2 * 1/2. Bowl: 0. Floors have no average precision.
    assert mean_average_precision([hit, miss], 0.5) == pytest.approx((0.25 + 0) / 2)
    assert mean_average_precision([], 0.5) is None


def test_right_stuff_is_no_false_thing() -> None:
    table = overlaps(
        row(_1=4, _2=4),
        row(_1=4, _2=4),
        {1: thing("rug", "carpet"), 2: stuff("floor-wood", "rug")},
        scored(_1=("rug", 0.5), _2=("rug", 0.9)),
    )
    assert mean_average_precision([table], 0.5) == 1


def test_mean_iou_by_hand() -> None:
    truth = {1: thing("cup"), 2: thing("chair", "couch"), 3: stuff("floor-wood")}
    table = overlaps(
        row(_1=10, _2=10, _3=20, _0=5),
        row(_1=6, _2=14, _3=10, _4=10, _5=5),
        truth,
        said(_1="cup", _2="couch", _3="floor-wood", _4="cup", _5="cup"),
    )
    # Cup: 6 of 10, and 10 of the floor: 6 / 20. Chair: all 10; that 4 of the cup are called couch costs the cup alone.
    # Floor: 10 / 20. The void does not count.
    found = semantic_quality([table])
    assert found.miou == pytest.approx((6 / 20 + 1 + 10 / 20) / 3)
    assert found.fw_iou == pytest.approx((10 * 6 / 20 + 10 * 1 + 20 * 0.5) / 40)


def test_mean_iou_without_truth() -> None:
    found = semantic_quality([overlaps(row(_0=3), row(_1=3), {}, said(_1="cup"))])
    assert found.miou is None
    assert found.fw_iou is None
