"""Stray parts of an object's surface on constructed voxels."""

from __future__ import annotations

import numpy as np

from uppm.fusion.cleaning import seldom_seen, stray_parts

SIZE = 0.02


def block(low: tuple[int, int, int], n: int) -> np.ndarray:
    return (np.array(list(np.ndindex(n, n, n))) + low + 0.5) * SIZE


def test_parts_seen_seldom_are_stray_and_true_parts_stay() -> None:
    body, leg, leak, touching = block((0, 0, 0), 6), block((20, 0, 0), 4), block((0, 40, -7), 4), block((6, 0, 0), 2)
    points = np.concatenate([body, leg, leak, touching])
    counts = np.concatenate([np.full(216, 10.0), np.full(64, 8.0), np.full(64, 1.0), np.full(8, 1.0)])
    stray = stray_parts(points, counts, SIZE)
    np.testing.assert_array_equal(stray, np.repeat([False, False, True, False], [216, 64, 64, 8]))


def test_one_part_is_never_stray() -> None:
    assert not stray_parts(block((-3, 5, 9), 3), np.ones(27), SIZE).any()


def test_seldom_seen_is_beside_the_most_often_seen_alone() -> None:
    counts = np.repeat([9.0, 7.0, 5.0, 1.0, 40.0], [50, 20, 10, 15, 5])
    np.testing.assert_array_equal(seldom_seen(counts), counts <= 5)
    assert not seldom_seen(np.ones(7)).any()
    assert seldom_seen(np.empty(0)).shape == (0,)
