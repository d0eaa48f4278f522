"""Blur, keyframes, and what perception hands to fusion."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from uppm.core.config import Config, PerceptionConfig
from uppm.core.language import Caption
from uppm.core.types import Frame
from uppm.perception.fakes import FakeCaptioner, FakeLabeler, FakeRetriever, FakeSegmenter, fake_frame
from uppm.perception.front_end import NOT_SHARP, FrontEnd
from uppm.perception.keyframes import KeyframePolicy, novelty
from uppm.perception.labels.caption import BLURRED, CaptionLabeler
from uppm.perception.sharpness import SharpnessJudge, sharpness
from uppm.pipeline import Mapper


def textured(index: int = 0, *, blur: int = 0) -> Frame:
    color = np.random.default_rng(index).integers(0, 256, (12, 16, 3), dtype=np.uint8)
    color = cv2.resize(color, (64, 48), interpolation=cv2.INTER_NEAREST)
    return replace(fake_frame(index), color=cv2.blur(color, (blur, blur)) if blur else color)


def moved(index: int, x: float = 0.0, degrees: float = 0.0) -> Frame:
    """A frame before the wall, moved to the side or turned about the vertical."""
    T, a = np.eye(4), np.radians(degrees)
    T[:3, :3] = [[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]]
    T[0, 3] = x
    return replace(fake_frame(index), T_map_camera=T)


def front_end(**settings: object) -> FrontEnd:
    config = PerceptionConfig.model_validate(settings)
    return FrontEnd(config, FakeLabeler("mug"), FakeSegmenter(), FakeRetriever())


def test_blur_lowers_sharpness_more_and_more() -> None:
    values = [sharpness(textured(blur=blur).color) for blur in (0, 3, 7, 15)]
    assert values == sorted(values, reverse=True)
    assert values[-1] < 0.05 * values[0]


def test_a_frame_far_less_sharp_than_the_others_is_blurred() -> None:
    judge = SharpnessJudge(0.3)
    assert not judge.is_blurred(textured(9, blur=15))
    judge.prepare([textured(n) for n in range(5)])
    assert not judge.is_blurred(textured(9))
    assert judge.is_blurred(textured(9, blur=15))


def test_blurred_frames_are_skipped_without_a_captioner() -> None:
    sharp = [textured(n) for n in range(3)]
    for settings, skip in (
        ({"min_sharpness": 0.3}, NOT_SHARP),
        ({}, None),
        ({"min_sharpness": 0.3, "skip_blurry": False}, None),
    ):
        perception = front_end(**settings)
        perception.prepare(sharp)
        assert perception.perceive(sharp[0]).skip is None
        assert perception.perceive(textured(9, blur=15)).skip == skip


def test_both_judges_of_blur_are_reported() -> None:
    """Frame 1 is called blurry by its caption, frame 2 is not, but is; each is counted under its judge's name."""
    captioner = FakeCaptioner("a desk", by_index={1: Caption(text="a blurry photo of a desk")})
    config = Config.model_validate({"perception": {"min_sharpness": 0.3}})
    mapper = Mapper(config, labeler=CaptionLabeler(captioner), segmenter=FakeSegmenter(), retriever=FakeRetriever())
    mapper.prepare([textured(n) for n in range(3)])
    for frame in (textured(0), textured(1), textured(2, blur=15), textured(3)):
        mapper.integrate(frame)
    assert (mapper.report.frames, mapper.report.skipped) == (2, {BLURRED: 1, NOT_SHARP: 1})


@pytest.mark.parametrize(
    ("frame", "share"),
    [(moved(1), 0.0), (moved(1, x=2 / 4), 0.25), (moved(1, x=5.0), 1.0), (moved(1, degrees=180), 1.0)],
)
def test_novelty_is_the_share_of_new_points(frame: Frame, share: float) -> None:
    """The view is two metres wide at the wall."""
    assert novelty(frame, moved(0)) == pytest.approx(share, abs=0.07)


def test_something_in_front_of_the_last_view_is_new() -> None:
    depth = np.full((48, 64), 2.0, dtype=np.float32)
    depth[:, :32] = 1.0
    assert novelty(replace(fake_frame(1), depth=depth), fake_frame(0)) == pytest.approx(0.5, abs=0.05)
    assert novelty(replace(fake_frame(1), depth=np.zeros_like(depth)), fake_frame(0)) == 0.0


def test_keyframes_by_motion_and_novelty() -> None:
    policy = KeyframePolicy(PerceptionConfig(keyframe="motion", keyframe_novelty=1.0))
    steps = [
        moved(0),
        moved(1, x=0.1),
        moved(2, x=0.25),
        moved(3, x=0.35),
        moved(4, x=0.4),
        moved(5, x=0.4, degrees=20),
    ]
    assert [policy.choose(frame) for frame in steps] == [True, False, False, True, False, True]
    policy.restart()
    assert policy.choose(steps[-1])
    every = KeyframePolicy(PerceptionConfig())
    assert all(every.choose(frame) for frame in steps)
    new = KeyframePolicy(PerceptionConfig(keyframe="motion", keyframe_translation=9.0, keyframe_novelty=0.2))
    assert [new.choose(frame) for frame in (moved(0), moved(1, x=0.3), moved(2, x=0.6))] == [True, False, True]


def test_between_keyframes_nothing_is_segmented() -> None:
    perception = front_end(keyframe="motion")
    first, second = perception.perceive(moved(0)), perception.perceive(moved(1, x=0.05))
    assert first.segmentation is not None
    assert [d.label for d in first.segmentation.descriptors] == ["chair", "wall"]
    assert second.segmentation is None
    assert second.skip is None
    assert second.dropped == {"frame between keyframes": 1}
