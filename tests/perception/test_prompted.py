"""The profile `foundation` around its back ends, with fakes in their place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest

from tests.perception.scenes import FIRST_BOX, box_around, room
from uppm.core.config import PerceptionConfig
from uppm.core.types import Detections, Label, Provenance
from uppm.perception.fakes import FakeLabeler, FakeMaskGenerator, fake_frame
from uppm.perception.segmentation.prompted import PromptedSegmenter, is_surface

CRATE = ((-0.4, 2.0, 0.5), (0.3, 2.5, 1.2))


class TableDetector:
    """Detector that finds the boxes that it was given, each for its own label if that is asked for."""

    def __init__(self, **boxes: tuple[float, float, float, float, float]) -> None:
        self._boxes = boxes

    def detect(self, color: npt.NDArray[np.uint8], labels: Sequence[Label] = ()) -> Detections:
        found = [(self._boxes[label.text], label) for label in labels if label.text in self._boxes]
        rows = np.array([box for box, _ in found], dtype=np.float32).reshape(-1, 5)
        return Detections(boxes=rows[:, :4], scores=rows[:, 4], labels=tuple(label for _, label in found))


def test_every_dropped_candidate_is_counted() -> None:
    detector = TableDetector(
        cup=(2, 2, 30, 40, 0.5), mug=(3, 2, 30, 41, 0.9), wall=(0, 0, 64, 48, 0.6), dot=(60, 1, 61, 2, 1)
    )
    labels = (
        *FakeLabeler("cup", "wall", "dot", "ghost").label(fake_frame()).labels,
        Label(text="mug", provenance=Provenance.TAG),
    )
    segmenter = PromptedSegmenter(PerceptionConfig(masks="box"), detector, FakeMaskGenerator())
    result = segmenter.segment(fake_frame(), labels)
    assert [(s.label.text, s.is_thing) for s in result.segments] == [("cup", True), ("wall", False)]
    assert result.dropped == {"near_duplicate_box": 1, "too_small": 1, "unlabeled_pixels": 0}
    assert (result.ids == 1).sum() == 28 * 38
    assert (result.ids > 0).all()


@pytest.mark.parametrize(("edges", "leak"), [("cut", False), ("keep", True)])
def test_leaks_are_cut_by_setting(edges: str, leak: bool) -> None:
    frame = room([CRATE])
    assert frame.truth is not None
    x0, y0, x1, y1 = box_around(frame.truth.instance == FIRST_BOX).tolist()
    box = (x0 - 8, y0 - 8, x1 + 8, y1 + 8, 0.9)
    config = PerceptionConfig.model_validate({"depth_edges": edges, "masks": "box"})
    segmenter = PromptedSegmenter(config, TableDetector(crate=box), FakeMaskGenerator())
    result = segmenter.segment(frame, FakeLabeler("crate").label(frame).labels)
    on_the_wall = np.count_nonzero((result.ids == 1) & (frame.truth.instance == 2))
    assert (on_the_wall > 300) == leak
    assert (result.dropped.get("leaked_pixels", 0) > 300) != leak


def test_without_labels_nothing_is_found() -> None:
    result = PromptedSegmenter(PerceptionConfig(masks="box"), TableDetector(), FakeMaskGenerator()).segment(
        fake_frame(), ()
    )
    assert result.segments == ()
    assert result.dropped == {"unlabeled_pixels": 48 * 64}


def test_surfaces_are_told_by_their_head_noun() -> None:
    assert all(map(is_surface, ("brick wall", "Floor", "sky", "grass", "carpet")))
    assert not any(map(is_surface, ("wall clock", "floor lamp", "cabinet", "")))


def test_a_profile_names_its_back_ends_and_their_models() -> None:
    full, light = PerceptionConfig(profile="foundation"), PerceptionConfig(profile="foundation-light")
    assert (full.detector, full.masks_model, full.prompts) == ("grounding_dino", "sam-vit-huge", "separate")
    assert (light.masks, light.masks_model, light.masks_side) == ("sam2", "sam2.1-hiera-tiny", 512)
    assert (light.detector, light.captioner) == ("owlvit", "vocabulary")
    # Another back end does not get the profile's model of its own.
    other = PerceptionConfig(profile="foundation", detector="owlv2", masks="sam2", prompts="joint")
    assert (other.detector_model, other.masks_model, other.prompts) == (None, None, "joint")
