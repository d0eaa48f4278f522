"""Masks cut where they leak over a depth step, on scenes whose true masks are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.perception.scenes import FIRST_BOX, iou, room
from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame
from uppm.perception.fakes import fake_frame
from uppm.perception.segmentation.depth_edges import cut_at_steps, cuts

# Hanging: where they stand, the floor joins what leaked beside them to them without a step.
CRATE = ((-0.4, 2.0, 0.5), (0.3, 2.5, 1.2))
POLE = ((-0.03, 2.0, 0.4), (0.03, 2.06, 1.6))


def truth_of(frame: Frame) -> np.ndarray:
    assert frame.truth is not None
    return frame.truth.instance == FIRST_BOX


def grown(mask: np.ndarray, pixels: int) -> np.ndarray:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)) > 0


@pytest.mark.parametrize("noise", [0.0, 0.001])
@pytest.mark.parametrize("box", [CRATE, POLE])
def test_what_leaked_to_the_wall_is_cut_off(box: tuple, noise: float) -> None:
    frame = room([box], noise=noise)
    truth = truth_of(frame)
    leaky = grown(truth, 6)
    (cut,), pixels = cut_at_steps(frame, leaky[None])
    assert iou(cut, truth) > iou(leaky, truth) + 0.05
    assert pixels == np.count_nonzero(leaky) - np.count_nonzero(cut)
    assert not (cut & ~leaky).any()
    assert iou(cut, truth) > 0.95


@pytest.mark.parametrize("box", [CRATE, POLE])
def test_a_mask_that_does_not_leak_stays_as_it_is(box: tuple) -> None:
    frame = room([box])
    (cut,), pixels = cut_at_steps(frame, truth_of(frame)[None])
    np.testing.assert_array_equal(cut, truth_of(frame))
    assert pixels == 0


def test_an_object_in_two_depths_keeps_both() -> None:
    """A chair's back behind its seat: a step inside the mask, but nothing goes on outside it."""
    depth = np.full((48, 64), 4.0, dtype=np.float32)
    depth[10:40, 10:30], depth[10:40, 30:50] = 2.0, 2.6
    frame = type(fake_frame())(**{**vars(fake_frame()), "depth": depth})
    mask = depth < 3
    (cut,), _ = cut_at_steps(frame, mask[None])
    np.testing.assert_array_equal(cut, mask)


def test_masks_without_pixels_or_depth_are_no_trouble() -> None:
    frame = room([CRATE])
    blind = type(frame)(**{**vars(frame), "depth": np.zeros_like(frame.depth)})
    empty = np.zeros(frame.depth.shape, dtype=bool)
    cut, pixels = cut_at_steps(blind, np.stack([empty, truth_of(frame)]))
    np.testing.assert_array_equal(cut, [empty, truth_of(frame)])
    assert pixels == 0
    none, pixels = cut_at_steps(frame, np.zeros((0, *frame.depth.shape), dtype=bool))
    assert (none.shape, pixels) == ((0, *frame.depth.shape), 0)


def test_the_setting() -> None:
    chosen = {
        (edges, from_depth): cuts(PerceptionConfig.model_validate({"depth_edges": edges}), from_depth=from_depth)
        for edges in ("auto", "cut", "keep") for from_depth in (True, False)
    }  # fmt: skip
    assert chosen == {
        ("auto", True): False, ("auto", False): True, ("cut", True): True, ("cut", False): True,
        ("keep", True): False, ("keep", False): False,
    }  # fmt: skip
