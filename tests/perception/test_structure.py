"""Gravity, floor and walls, and the assembly of segments into one image."""

from __future__ import annotations

import numpy as np
import pytest

from tests.conftest import shared_data
from tests.perception.scenes import FLOOR, WALL, iou, room
from uppm import open_sequence
from uppm.core.types import Detections, Frame, Label, Provenance, Segment
from uppm.perception.fakes import fake_frame
from uppm.perception.segmentation.assembly import assemble, distinct_boxes
from uppm.perception.segmentation.gravity import estimate_gravity
from uppm.perception.segmentation.plausible import has_plausible_size, off_the_floor
from uppm.perception.segmentation.structure import find_structure


def segment(text: str, score: float = 0.5, thing: bool = True) -> Segment:
    provenance = Provenance.DETECTOR if thing else Provenance.STRUCTURE
    return Segment(label=Label(text=text, provenance=provenance), score=score, is_thing=thing)


def half(frame: Frame, left: float, right: float) -> np.ndarray:
    mask = np.zeros(frame.depth.shape, dtype=bool)
    width = frame.intrinsics.width
    mask[:, int(left * width) : int(right * width)] = True
    return mask


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_gravity_of_a_room(noise: float) -> None:
    gravity = estimate_gravity([room(noise=noise, pitch=pitch) for pitch in (10, 20, 30)])
    assert gravity.up @ (0, 0, 1) > np.cos(np.radians(0.5))
    assert gravity.floor == pytest.approx(0, abs=0.02)
    assert gravity.ceiling is None


def test_a_named_axis_is_taken_as_it_is() -> None:
    gravity = estimate_gravity([room()], "-y")
    np.testing.assert_array_equal(gravity.up, (0, -1, 0))


def test_frames_without_depth_have_the_cameras_up_and_no_floor() -> None:
    frame = room()
    blind = type(frame)(**{**vars(frame), "depth": np.zeros_like(frame.depth)})
    gravity = estimate_gravity([blind])
    assert gravity.floor is None
    assert np.linalg.norm(gravity.up) == pytest.approx(1)
    assert find_structure(blind, gravity) == []


def test_floor_and_wall_are_found_where_they_are() -> None:
    frame = room([((-0.4, 2.0, 0.0), (0.3, 2.5, 0.4))])
    assert frame.truth is not None
    found = find_structure(frame, estimate_gravity([frame]))
    by_name = {s.label.text: mask for mask, s in found}
    assert set(by_name) == {"floor", "wall"}
    assert iou(by_name["floor"], frame.truth.instance == FLOOR) > 0.95
    assert iou(by_name["wall"], frame.truth.instance == WALL) > 0.95
    assert not any(s.is_thing for _, s in found)


def test_the_top_of_a_table_is_a_table() -> None:
    frame = room([((-0.6, 1.5, 0.65), (0.6, 2.2, 0.7))])
    found = find_structure(frame, estimate_gravity([frame]))
    tables = [s for _, s in found if s.label.text == "table"]
    assert len(tables) == 1
    assert tables[0].is_thing


def test_gravity_of_the_flat() -> None:
    source = open_sequence(shared_data("data/flat/run1"))
    gravity = estimate_gravity([source.frame(i) for i in range(0, len(source), 15)])
    assert gravity.up @ (0, 0, 1) > np.cos(np.radians(1))
    assert gravity.floor == pytest.approx(0, abs=0.03)
    assert gravity.ceiling == pytest.approx(2.6, abs=0.05)


def test_things_are_painted_over_stuff_and_the_higher_score_first() -> None:
    frame = fake_frame()
    candidates = [
        (half(frame, 0, 1), segment("wall", 0.9, thing=False)),
        (half(frame, 0.2, 0.6), segment("chair", 0.5)),
        (half(frame, 0.4, 0.8), segment("couch", 0.8)),
    ]
    result = assemble(frame, candidates, min_pixels=10)
    assert [s.label.text for s in result.segments] == ["couch", "chair", "wall"]
    row = result.ids[0]
    assert (row[int(0.5 * 64)], row[int(0.3 * 64)], row[0]) == (1, 2, 3)
    assert result.dropped["unlabeled_pixels"] == 0


def test_what_stands_on_a_table_keeps_its_pixels() -> None:
    frame = fake_frame()
    candidates = [(half(frame, 0, 1), segment("table", 0.9)), (half(frame, 0.4, 0.5), segment("cup", 0.4))]
    result = assemble(frame, candidates, min_pixels=10)
    assert [s.label.text for s in result.segments] == ["cup", "table"]


def test_a_table_top_that_a_bed_covers_is_the_beds() -> None:
    frame = fake_frame()
    top = Segment(label=Label(text="table", provenance=Provenance.STRUCTURE), score=0.3, is_thing=True)
    result = assemble(frame, [(half(frame, 0, 0.5), segment("bed")), (half(frame, 0, 0.8), top)], min_pixels=10)
    assert [s.label.text for s in result.segments] == ["bed"]
    assert result.dropped["hidden_by_others"] == 1


def test_each_dropped_segment_is_counted_with_its_reason() -> None:
    frame = fake_frame()
    small = np.zeros(frame.depth.shape, dtype=bool)
    small[0, 0] = True
    hidden = (half(frame, 0, 0.5), segment("chair", 0.3))
    candidates = [(half(frame, 0, 0.5), segment("couch", 0.8)), hidden, (small, segment("bed"))]
    result = assemble(frame, candidates, min_pixels=500, dropped={"duplicate_box": 2})
    assert [s.label.text for s in result.segments] == ["couch"]
    unlabeled = int((~half(frame, 0, 0.5)).sum())
    expected = {"duplicate_box": 2, "hidden_by_others": 1, "too_small": 1, "unlabeled_pixels": unlabeled}
    assert result.dropped == expected


def test_nothing_found_leaves_every_pixel_counted() -> None:
    frame = fake_frame()
    result = assemble(frame, [], min_pixels=10)
    assert result.segments == ()
    assert result.dropped["unlabeled_pixels"] == frame.depth.size


def test_small_things_may_be_smaller() -> None:
    frame = fake_frame()
    mask = np.zeros(frame.depth.shape, dtype=bool)
    mask[:2, :3] = True
    for text, kept in (("cup", 1), ("couch", 0)):
        assert len(assemble(frame, [(mask, segment(text))], min_pixels=1000).segments) == kept


def test_two_boxes_on_one_object_are_one() -> None:
    boxes = np.array([[0, 0, 100, 100], [5, 0, 100, 100], [200, 0, 300, 100], [210, 10, 240, 40]], dtype=np.float32)
    labels = tuple(Label(text=t, provenance=Provenance.DETECTOR) for t in ("chair", "couch", "cup", "cup"))
    found = Detections(boxes=boxes, scores=np.array([0.5, 0.6, 0.7, 0.4], dtype=np.float32), labels=labels)
    assert distinct_boxes(found, np.arange(4)) == [2, 1]


def test_a_cup_of_two_metres_is_none() -> None:
    frame = fake_frame(depth=2.0)
    assert not has_plausible_size(frame, half(frame, 0, 1), "cup")
    assert has_plausible_size(frame, half(frame, 0, 1), "couch")
    assert has_plausible_size(frame, half(frame, 0, 0.1), "no such category")


def test_the_floor_is_taken_off_a_mask_unless_that_leaves_nothing() -> None:
    frame = fake_frame()
    floor = [(half(frame, 0, 0.5), segment("floor", thing=False))]
    np.testing.assert_array_equal(off_the_floor(half(frame, 0, 1), floor), half(frame, 0.5, 1))
    np.testing.assert_array_equal(off_the_floor(half(frame, 0, 0.5), floor), half(frame, 0, 0.5))
