"""Pictures of a front end's errors, and of what a map was found to know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from uppm.core.categories import category_by_name
from uppm.core.types import DescribedSegmentation, ElementaryDescriptor, GroundTruth, Provenance
from uppm.evaluation.error_colors import InstanceError
from uppm.evaluation.ground_truth import TruthInstance
from uppm.evaluation.language import PromptOutcome
from uppm.perception.fakes import fake_frame
from uppm.regimes.frame_pictures import WIDTH, draw_frame
from uppm.regimes.query import Found, how_often_found


def said(name: str) -> ElementaryDescriptor:
    category = category_by_name()[name]
    return ElementaryDescriptor(label=name, category=category, provenance=Provenance.DETECTOR, score=0.9)


def true(number: int, *categories: str) -> TruthInstance:
    return TruthInstance(id=number, name=categories[0], is_thing=True, categories=categories, pixels=10**6)


def test_each_pixel_of_a_frame_has_the_colour_of_its_error() -> None:
    frame = fake_frame(0)
    height, width = frame.depth.shape
    truth, ids = np.zeros((height, width), np.int32), np.zeros((height, width), np.int32)
    # Six stripes: cup, chair, chair again, vase, nobody knows, vase without a segment.
    stripe = np.minimum(np.arange(width) * 6 // width, 5)
    truth[:] = np.array([1, 2, 2, 3, 0, 3])[stripe]
    # The second segment is mainly the chair, called a bed, and reaches over the vase.
    ids[:] = np.array([1, 2, 2, 2, 3, 0])[stripe]
    found = DescribedSegmentation(
        ids=ids, descriptors=(said("cup"), said("bed"), said("bowl")), is_thing=(True, True, True)
    )
    truths = {1: true(1, "cup"), 2: true(2, "chair"), 3: true(3, "vase")}
    frame = replace(frame, truth=GroundTruth(instance=truth, names={}, things=frozenset()))
    picture = draw_frame(frame, found, truths)
    assert picture.shape[1] > 3 * WIDTH
    middle = picture.shape[0] // 2
    errors = picture[middle, -WIDTH:].astype(float)
    expected = ["RIGHT", "MISNAMED", "MISNAMED", "FOREIGN", "NO_TRUTH", "UNLABELED"]
    for n, name in enumerate(expected):
        place = errors[int((n + 0.5) * WIDTH / 6)]
        # Over the frame in grey: what differs between channels is the colour's own, weakened alike.
        color = np.array(InstanceError[name].value, dtype=float)
        assert place - place.mean() == pytest.approx(0.65 * (color - color.mean()), abs=2), name


def test_without_ground_truth_nothing_is_drawn() -> None:
    frame = replace(fake_frame(0), truth=None)
    ids = np.zeros(frame.depth.shape, np.int32)
    with pytest.raises(ValueError, match="without ground truth"):
        draw_frame(frame, DescribedSegmentation(ids=ids, descriptors=(), is_thing=()), {})


def outcome(*answers: int, wanted: tuple[frozenset[int], ...]) -> PromptOutcome:
    return PromptOutcome(prompt="", meaning="", wanted=wanted, answers=answers, probability=0.5)


def test_how_often_each_submap_was_found() -> None:
    found = how_often_found(
        [
            outcome(1, 9, wanted=(frozenset({1}), frozenset({2}))),
            outcome(1, wanted=(frozenset({1, 3}),)),
            outcome(3, wanted=(frozenset({3}),)),
            outcome(4, wanted=()),
        ]
    )
    assert found == {1: Found.ALWAYS, 2: Found.NEVER, 3: Found.SOMETIMES}
