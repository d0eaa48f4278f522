"""Association on constructed cases."""

from __future__ import annotations

import numpy as np

from uppm.core.categories import category_by_name, label_category, unified_categories
from uppm.fusion.tracking import NEW, CategoryPolicy, assign, covered_together, iou_matrix, join_contained


def test_iou_counts_pixels_with_depth() -> None:
    overlap = np.array([[10, 30, 0], [0, 0, 50]])
    iou = iou_matrix(overlap, np.array([40, 100]))
    np.testing.assert_allclose(iou, [[30 / 50, 0], [0, 50 / 100]])


def test_assignment_is_optimal_and_one_to_one() -> None:
    # Greedy would give segment 0 to submap 0 (0.6) and leave segment 1 with 0.1.
    iou = np.array([[0.6, 0.55], [0.5, 0.1]])
    np.testing.assert_array_equal(assign(iou, np.full((2, 2), 0.1)), [1, 0])


def test_below_the_least_iou_is_new() -> None:
    np.testing.assert_array_equal(assign(np.array([[0.09, 0.3]]), np.full((1, 2), 0.1)), [NEW, 0])
    np.testing.assert_array_equal(assign(np.empty((0, 2)), np.empty((0, 2))), [NEW, NEW])


def test_less_agreement_asks_for_more_overlap() -> None:
    ids = [category_by_name()[name].id for name in ("chair", "couch", "clouds")]
    similarity = np.eye(171, dtype=np.float32)
    rows = [n for n, c in enumerate(unified_categories()) if c.id in ids[:2]]
    similarity[rows[0], rows[1]] = similarity[rows[1], rows[0]] = 0.75
    least = CategoryPolicy("compatible", 0.5, similarity).least_overlap(ids[:1], ids, 0.1)
    np.testing.assert_allclose(least[0, :2], [0.1, 0.1 + 0.5 * 0.5])
    assert np.isinf(least[0, 2])
    same = CategoryPolicy("same", 0.5, similarity).least_overlap(ids[:1], ids, 0.1)
    np.testing.assert_array_equal(np.isinf(same), [[False, True, True]])
    np.testing.assert_allclose(CategoryPolicy("any", 0.5, similarity).least_overlap(ids[:1], ids, 0.1), [[0.1] * 3])


def test_only_the_lenient_policy_is_ever_certain() -> None:
    similarity = np.eye(171, dtype=np.float32)
    assert CategoryPolicy("compatible", 0.5, similarity, 0.5).certain_iou == 0.5
    assert np.isinf(CategoryPolicy("same", 0.5, similarity, 0.5).certain_iou)


def test_one_segment_over_two_submaps_is_noticed() -> None:
    # Rows: the target, a duplicate, a sliver, one half outside, one with its own segment.
    overlap = np.array([[0, 500, 0], [20, 300, 0], [0, 90, 0], [300, 300, 0], [0, 0, 400]])
    observed, allowed = np.array([800, 400]), np.ones((5, 2), dtype=np.bool_)
    targets = np.array([0, 4])
    assert covered_together(targets, overlap, observed, allowed) == [(0, 1)]
    allowed[1] = False
    assert covered_together(targets, overlap, observed, allowed) == []


def test_a_part_joins_the_whole_that_it_lies_on() -> None:
    overlap = np.array([[0, 9000, 800, 50]])
    observed = np.array([9500, 1000, 1000])
    allowed = np.array([[True, True, True]])
    targets = join_contained(np.array([0, NEW, NEW]), overlap, observed, allowed, 0.6)
    np.testing.assert_array_equal(targets, [0, 0, NEW])
    refused = join_contained(np.array([0, NEW, NEW]), overlap, observed, ~allowed, 0.6)
    np.testing.assert_array_equal(refused, [0, NEW, NEW])
    # The corner of a wall beyond a door, rendered at three pixels of 16: chance.
    chance = join_contained(np.array([NEW]), np.array([[0, 48]]), np.array([15000]), np.array([[True]]), 0.6)
    np.testing.assert_array_equal(chance, [NEW])


def test_a_category_outside_the_table_goes_with_itself_only() -> None:
    chair, couch, sofa = category_by_name()["chair"].id, label_category("couch").id, label_category("sofa").id
    policy = CategoryPolicy("compatible", 0.5, np.ones((171, 171), dtype=np.float32))
    least = policy.least_overlap([chair, couch], [chair, couch, sofa], 0.1)
    np.testing.assert_array_equal(least, [[0.1, np.inf, np.inf], [np.inf, 0.1, np.inf]])
