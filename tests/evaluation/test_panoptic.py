from __future__ import annotations

from collections import defaultdict

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uppm.evaluation.overlaps import PredictedSegment, TrueSegment, overlaps
from uppm.evaluation.panoptic import count_matches, panoptic_quality

Ids = npt.NDArray[np.int64]


def thing(*classes: str) -> TrueSegment:
    return TrueSegment(classes=classes, is_thing=True)


def stuff(*classes: str) -> TrueSegment:
    return TrueSegment(classes=classes, is_thing=False)


def said(**names: str) -> dict[int, PredictedSegment]:
    """said(_1="cup") is segment 1, called a cup."""
    return {int(key[1:]): PredictedSegment(name=name) for key, name in names.items()}


def row(**runs: int) -> Ids:
    """row(_3=5, _0=2): five elements of id 3, then two of id 0."""
    return np.repeat([int(key.split("_")[1]) for key in runs], list(runs.values()))


def test_hand_computed() -> None:
    truth, predicted = row(_1=10, _2=10, _3=20), row(_5=8, _6=12, _7=20)
    # Cup 1: 8 of 10, IoU 0.8. Cup 2: 10 of 12, IoU 10/12. Floor 3 is called a wall: one missed, one false.
    found = panoptic_quality(
        [
            count_matches(
                overlaps(
                    truth,
                    predicted,
                    {1: thing("cup"), 2: thing("cup"), 3: stuff("floor-wood")},
                    said(_5="cup", _6="cup", _7="wall-wood"),
                )
            )
        ]
    )
    assert found.per_class["cup"].sq == pytest.approx((0.8 + 10 / 12) / 2)
    assert found.per_class["cup"].rq == 1
    assert (found.per_class["floor-wood"].fn, found.per_class["wall-wood"].fp) == (1, 1)
    assert found.all.pq == pytest.approx((0.8 + 10 / 12) / 2 / 3)
    assert found.all.rq == pytest.approx(1 / 3)
    assert found.things.pq == pytest.approx((0.8 + 10 / 12) / 2)
    assert found.stuff.pq == 0
    assert (found.classes, found.classes_without_truth) == (3, 1)


def test_images_add_up() -> None:
    hit = overlaps(row(_1=4), row(_1=4), {1: thing("cup")}, said(_1="cup"))
    miss = overlaps(row(_1=4), row(_0=4), {1: thing("cup")}, {})
    found = panoptic_quality([count_matches(hit), count_matches(miss)])
    # TP 1, FN 1: RQ = 1 / 1.5.
    assert found.all.pq == pytest.approx(1 / 1.5)


def test_half_is_not_a_match() -> None:
    counts = count_matches(overlaps(row(_1=10), row(_1=5, _0=5), {1: thing("cup")}, said(_1="cup")))
    assert (counts["cup"].tp, counts["cup"].fp, counts["cup"].fn) == (0, 1, 1)


def test_void_counts_for_nothing() -> None:
    truth, predicted = row(_1=10, _0=30), np.concatenate([row(_1=19), row(_2=10, _3=11)])
    table = overlaps(truth, predicted, {1: thing("cup")}, said(_1="cup", _2="bowl", _3="vase"))
    counts = count_matches(table)
    # 9 of the cup's 19 elements lie in the void and do not weigh on its IoU; bowl and vase lie there altogether.
    assert counts["cup"].iou == 1
    assert set(counts) == {"cup"}


def test_any_right_class_matches_and_counts_as_the_first() -> None:
    counts = count_matches(overlaps(row(_1=4), row(_9=4), {1: thing("chair", "couch")}, said(_9="couch")))
    assert set(counts) == {"chair"}
    assert counts["chair"].tp == 1


def test_stuff_is_one_segment_a_class() -> None:
    truth = {1: stuff("floor-other", "floor-wood"), 2: stuff("floor-other", "floor-wood")}
    table = overlaps(
        row(_1=10, _2=10), row(_1=5, _2=5, _3=10), truth, said(_1="floor-wood", _2="floor-other", _3="floor-wood")
    )
    counts = count_matches(table)
    assert (counts["floor-other"].tp, counts["floor-other"].iou) == (1, 1)


def test_a_rug_called_carpet_stays_apart_from_the_floor() -> None:
    truth = {1: stuff("floor-other", "carpet"), 2: thing("rug", "carpet")}
    table = overlaps(row(_1=10, _2=10), row(_4=5, _5=5, _6=10), truth, said(_4="carpet", _5="floor-other", _6="carpet"))
    counts = count_matches(table)
    assert {name: (c.tp, c.fp, c.fn, c.iou) for name, c in counts.items()} == {
        "floor-other": (1, 0, 0, 1.0),
        "rug": (1, 0, 0, 1.0),
    }


def test_what_is_known_to_be_nothing_counts_against() -> None:
    truth = np.concatenate([row(_1=10), np.full(6, -1)])
    table = overlaps(truth, row(_1=14, _2=2), {1: thing("cup")}, said(_1="cup", _2="cat"))
    counts = count_matches(table)
    assert counts["cup"].iou == pytest.approx(10 / 14)
    assert counts["cat"].fp == 1


def test_without_anything() -> None:
    found = panoptic_quality([count_matches(overlaps(row(_0=5), row(_0=5), {}, {}))])
    assert found.all.pq is None
    assert found.classes == 0


def second_implementation(
    truth: Ids, predicted: Ids, classes: dict[int, str], names: dict[int, str]
) -> dict[str, list]:
    """PQ by the definition, over sets of elements; every class's segments already apart. tp, fp, fn, sum of IoU."""
    counts = defaultdict(lambda: [0, 0, 0, 0.0])
    void = {i for i, t in enumerate(truth) if t == 0}
    true_sets = {t: {i for i, v in enumerate(truth) if v == t} for t in set(truth.tolist()) - {0}}
    sets = {p: {i for i, v in enumerate(predicted) if v == p} for p in set(predicted.tolist()) - {0}}
    matched = set()
    for t, of_truth in true_sets.items():
        for p, of_prediction in sets.items():
            iou = len(of_truth & of_prediction) / len(of_truth | (of_prediction - void))
            if classes[t] == names[p] and iou > 0.5:
                counts[classes[t]][0] += 1
                counts[classes[t]][3] += iou
                matched |= {("t", t), ("p", p)}
    for t in true_sets:
        counts[classes[t]][2] += ("t", t) not in matched
    for p, of_prediction in sets.items():
        if ("p", p) not in matched and len(of_prediction & void) / len(of_prediction) <= 0.5:
            counts[names[p]][1] += 1
    return counts


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_agrees_with_a_second_implementation(seed: int) -> None:
    random = np.random.default_rng(seed)
    names = ["cup", "bowl", "chair"]
    truth = np.repeat(random.integers(0, 6, 12), random.integers(1, 9, 12))
    predicted = np.where(random.random(len(truth)) < 0.25, random.integers(0, 7, len(truth)), (truth * 7 + 1) % 7)
    classes = {i: names[random.integers(3)] for i in range(1, 6)}
    said_names = {i: names[random.integers(3)] for i in range(1, 7)}
    table = overlaps(
        truth,
        predicted,
        {i: thing(name) for i, name in classes.items()},
        {i: PredictedSegment(name=name) for i, name in said_names.items()},
    )
    expected = second_implementation(truth, predicted, classes, said_names)
    found = {name: [c.tp, c.fp, c.fn, pytest.approx(c.iou)] for name, c in count_matches(table).items()}
    assert {name: counts for name, counts in expected.items() if any(counts)} == found
