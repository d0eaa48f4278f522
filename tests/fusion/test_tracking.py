"""Association on constructed cases."""

from __future__ import annotations

import numpy as np

from uppm.fusion.tracking import NEW, assign, iou_matrix, join_contained, least_iou


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


def test_less_agreement_asks_for_more_iou() -> None:
    similarity = np.array([[1, 0.75, 0.2], [0.75, 1, 0.2], [0.2, 0.2, 1]], dtype=np.float32)
    submaps, segments = np.array([0]), np.array([0, 1, 2])
    compatible = least_iou(submaps, segments, similarity, "compatible", 0.1, 0.5)
    np.testing.assert_allclose(compatible[0, :2], [0.1, 0.1 + 0.5 * 0.5])
    assert np.isinf(compatible[0, 2])
    assert np.isinf(least_iou(submaps, segments, similarity, "same", 0.1, 0.5)[0, 1:]).all()
    np.testing.assert_allclose(least_iou(submaps, segments, similarity, "any", 0.1, 0.5), [[0.1, 0.1, 0.1]])


def test_a_part_joins_the_whole_that_it_lies_on() -> None:
    overlap = np.array([[0, 900, 80, 5]])
    observed = np.array([950, 100, 100])
    allowed = np.array([[True, True, True]])
    targets = join_contained(np.array([0, NEW, NEW]), overlap, observed, allowed, 0.6)
    np.testing.assert_array_equal(targets, [0, 0, NEW])
    refused = join_contained(np.array([0, NEW, NEW]), overlap, observed, ~allowed, 0.6)
    np.testing.assert_array_equal(refused, [0, NEW, NEW])
