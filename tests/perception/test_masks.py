"""Masks from depth, on scenes whose true masks are known, and on the rendered flat."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from tests.conftest import shared_data
from tests.perception.scenes import FIRST_BOX, box_around, iou, room
from uppm import open_sequence
from uppm.core.config import PerceptionConfig
from uppm.perception.registry import create_mask_generator
from uppm.perception.segmentation.surfaces import surfaces

CRATE = ((-0.4, 2.0, 0.0), (0.3, 2.5, 0.7))
FAR_CRATE = ((0.2, 3.0, 0.0), (0.9, 3.5, 1.2))


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_a_crate_on_the_floor_is_cut_out(noise: float) -> None:
    frame = room([CRATE], noise=noise)
    assert frame.truth is not None
    truth = frame.truth.instance == FIRST_BOX
    found = create_mask_generator(PerceptionConfig()).masks(frame, box_around(truth)[None])[0]
    assert iou(found, truth) > 0.93


def test_the_crate_behind_is_not_taken_for_the_one_in_front() -> None:
    frame = room([CRATE, FAR_CRATE])
    assert frame.truth is not None
    for instance in (FIRST_BOX, FIRST_BOX + 1):
        truth = frame.truth.instance == instance
        found = create_mask_generator(PerceptionConfig()).masks(frame, box_around(truth)[None])[0]
        assert iou(found, truth) > 0.9


def test_a_sheet_on_the_floor_is_found_by_its_colour() -> None:
    frame = room([((-0.3, 1.8, 0.0), (0.3, 2.3, 0.002))])
    assert frame.truth is not None
    truth = frame.truth.instance == FIRST_BOX
    found = create_mask_generator(PerceptionConfig()).masks(frame, box_around(truth)[None])[0]
    assert iou(found, truth) > 0.8


def test_masks_stay_in_their_boxes_and_on_valid_depth() -> None:
    frame = room([CRATE])
    depth = frame.depth.copy()
    depth[::3] = 0
    holes = type(frame)(**{**vars(frame), "depth": depth})
    boxes = np.array([[100, 60, 200, 200], [-5, -5, 40, 40], [300, 220, 330, 250], [10, 10, 10.2, 10.2]], np.float32)
    masks = create_mask_generator(PerceptionConfig()).masks(holes, boxes)
    assert masks.shape == (4, 240, 320)
    assert not (masks & (depth == 0)).any()
    for mask, (x0, y0, x1, y1) in zip(masks, boxes, strict=True):
        rows, columns = np.nonzero(mask)
        assert ((columns >= x0 - 1) & (columns <= x1) & (rows >= y0 - 1) & (rows <= y1)).all()


def test_no_boxes_give_no_masks() -> None:
    frame = room()
    for name in ("geometric", "box"):
        masks = create_mask_generator(PerceptionConfig(masks=name)).masks(frame, np.zeros((0, 4), np.float32))
        assert masks.shape == (0, 240, 320)


def test_a_frame_without_depth_gives_empty_masks() -> None:
    frame = room()
    blind = type(frame)(**{**vars(frame), "depth": np.zeros_like(frame.depth)})
    masks = create_mask_generator(PerceptionConfig()).masks(blind, np.array([[10, 10, 90, 90]], np.float32))
    assert not masks.any()


def test_normals_and_planes_of_the_room() -> None:
    frame = room()
    surface = surfaces(frame)
    in_map = surface.normals @ frame.T_map_camera[:3, :3].T
    assert surface.count == 2
    for label, normal in ((1, (0, 0, 1)), (2, (0, -1, 0))):
        assert frame.truth is not None
        here = (frame.truth.instance == label) & (surface.patches > 0)
        inner = here & (surface.patches == np.bincount(surface.patches[here]).argmax())
        assert np.median(in_map[inner] @ np.array(normal)) > 0.9999
        plane = surface.planes[surface.patches[inner][0]]
        np.testing.assert_allclose(frame.T_map_camera[:3, :3] @ plane[:3], normal, atol=1e-3)
        np.testing.assert_allclose(surface.points[inner] @ plane[:3] + plane[3], 0, atol=2e-3)


def flat_mask_iou(indices: Iterable[int]) -> dict[str, float]:
    """Mean IoU by generator over the things of over 1500 pixels in some frames of the flat, from their true boxes."""
    source = open_sequence(shared_data("data/flat/run1"))
    values: dict[str, list[float]] = {"geometric": [], "box": []}
    for index in indices:
        frame = source.frame(index)
        assert frame.truth is not None
        ids, counts = np.unique(frame.truth.instance, return_counts=True)
        things = [i for i, n in zip(ids, counts, strict=True) if n > 1500 and i in frame.truth.things]
        true = [frame.truth.instance == i for i in things]
        boxes = np.stack([box_around(mask) for mask in true]) if true else np.empty((0, 4), dtype=np.float32)
        for name, found in values.items():
            masks = create_mask_generator(PerceptionConfig(masks=name)).masks(frame, boxes)
            found += [iou(a, b) for a, b in zip(masks, true, strict=True)]
    return {name: float(np.mean(found)) for name, found in values.items()}


def test_masks_on_the_flat_are_far_better_than_boxes() -> None:
    mean = flat_mask_iou((12, 37, 61, 95, 133, 166))
    assert mean["geometric"] > 0.75
    assert mean["geometric"] > mean["box"] + 0.15


@pytest.mark.heavy
def test_masks_on_the_flat_reach_what_the_docs_say() -> None:
    assert flat_mask_iou(range(0, 180, 5))["geometric"] >= 0.80
