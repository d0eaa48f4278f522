from __future__ import annotations

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uppm.core.errors import InputError
from uppm.evaluation.tracks import frame_assignment, id_switches


def test_the_majority_of_labeled_pixels_decides() -> None:
    truth = np.array([[1, 1, 1, 1, 1, 2, 2, 3, 3, 0]])
    submaps = np.array([[7, 7, 8, 0, 0, 9, 8, 0, 0, 7]])
    # Instance 1: two of its three labeled pixels; 2: a tie; 3: none labeled.
    assert frame_assignment(truth, submaps) == {1: 7}
    assert frame_assignment(truth, np.zeros_like(truth)) == {}


def test_switches_by_hand() -> None:
    assert id_switches([{1: 7, 2: 8}, {1: 7}, {1: 9, 2: 8}, {1: 7, 2: 8}]) == 2
    assert id_switches([{1: 7}, {}, {1: 7}, {2: 7}]) == 0
    assert id_switches([]) == 0


def test_images_of_two_sizes() -> None:
    with pytest.raises(InputError, match=r"submap image: expected \(2, 3\), found \(3, 2\)"):
        frame_assignment(np.zeros((2, 3), int), np.zeros((3, 2), int))


@given(st.lists(st.dictionaries(st.integers(1, 4), st.integers(1, 3)), max_size=20))
def test_switches_are_the_steps_of_each_instances_own_track(frames: list[dict[int, int]]) -> None:
    tracks = [[frame[instance] for frame in frames if instance in frame] for instance in range(1, 5)]
    assert id_switches(frames) == sum(len(list(groupby(track))) - 1 for track in tracks if track)
