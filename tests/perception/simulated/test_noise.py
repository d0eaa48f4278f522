"""Each rate happens as often as it says, alone, and nothing depends on the order of frames."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from tests.perception.simulated.scenes import RUG, SOFA, THINGS, frame_of_things
from uppm.core.config import SimulatedConfig
from uppm.core.types import Frame
from uppm.perception.simulated.names import names_of
from uppm.perception.simulated.noise import FrameNoise, InstanceNoise, frame_noise

RATES = (
    "synonym", "wrong", "unmentioned", "untagged", "false_tags", "missed", "split", "merged", "duplicated", "part",
    "mask_pixels", "box_jitter", "blurred", "unflagged",
)  # fmt: skip
FRAMES = [frame_of_things(index) for index in range(300)]


def only(**rates: float) -> SimulatedConfig:
    """No noise but what is named, with a new draw each frame."""
    return SimulatedConfig.model_validate({**dict.fromkeys(RATES, 0.0), "hold": 1, **rates})


def noise_of(frame: Frame, config: SimulatedConfig) -> FrameNoise:
    assert frame.truth is not None
    return frame_noise(frame, frame.truth, config)


def things(config: SimulatedConfig) -> list[InstanceNoise]:
    return things_of(config.model_dump_json())


@cache
def things_of(config: str) -> list[InstanceNoise]:
    noises = (noise_of(frame, SimulatedConfig.model_validate_json(config)) for frame in FRAMES)
    return [i for noise in noises for i in noise.instances if i.is_thing]


@pytest.mark.parametrize(
    ("rate", "happened"),
    [
        ("synonym", lambda i: i.name != i.truth),
        ("wrong", lambda i: i.wrong and i.name in names_of(i.truth).near),
        ("unmentioned", lambda i: not i.in_caption),
        ("untagged", lambda i: not i.in_tags),
        ("missed", lambda i: i.missed),
        ("split", lambda i: i.split is not None),
        ("merged", lambda i: i.merged),
        ("duplicated", lambda i: i.duplicated),
        ("part", lambda i: i.part is not None),
    ],
)
def test_a_rate_is_how_often_it_happens(rate: str, happened: Callable[[InstanceNoise], bool]) -> None:
    seen = things(only(**{rate: 0.2}))
    # 1200 draws: three standard deviations are 0.035.
    assert np.mean([happened(i) for i in seen]) == pytest.approx(0.2, abs=0.035)
    assert not any(happened(i) for i in things(only()))
    assert np.mean([happened(i) for i in things(only(**{rate: 0.2, "level": 2.0}))]) == pytest.approx(0.4, abs=0.043)


def test_raising_one_rate_leaves_other_events_and_keeps_its_own() -> None:
    few, more = things(only(missed=0.1, split=0.1)), things(only(missed=0.3, split=0.1))
    assert [i.split for i in few] == [i.split for i in more]
    assert all(m.missed for f, m in zip(few, more, strict=True) if f.missed)


def test_all_names_are_used_and_none_of_another_object() -> None:
    called = {i.name for i in things(only(synonym=0.9)) if i.instance == SOFA}
    assert called == set(names_of("sofa").names)


def test_boxes_and_masks_vary_as_told() -> None:
    first = [i.boxes[0] for i in things(only(box_jitter=0.05, mask_pixels=8))]
    assert np.std([box.jitter for box in first]) == pytest.approx(0.05, rel=0.05)
    grow = np.array([box.grow for box in first])
    # At a width of 320, half of 8 pixels at 640.
    assert np.abs(grow).max() == pytest.approx(4, rel=0.01)
    assert grow.mean() == pytest.approx(0, abs=0.15)


def test_wrong_calls_score_less() -> None:
    seen = things(SimulatedConfig(wrong=0.5, blurred=0))
    right, wrong = ([i.boxes[0].score for i in seen if i.wrong is kind] for kind in (False, True))
    assert np.mean(right) == pytest.approx(0.6, abs=0.02)
    assert np.mean(wrong) == pytest.approx(0.5, abs=0.02)
    assert {i.boxes[0].score for i in things(SimulatedConfig(level=0))} == {1.0}


def test_false_tags_are_of_what_is_not_there() -> None:
    tags = [tag for frame in FRAMES for tag in noise_of(frame, only(false_tags=0.5)).false_tags]
    assert len(tags) / len(FRAMES) == pytest.approx(0.5, abs=0.12)
    assert not {tag.name for tag in tags} & {"sofa", "TV", "rug", "chair", "floor"}


def test_blurred_frames_are_flagged_but_for_some_and_doubly_noisy() -> None:
    config = only(blurred=0.3, unflagged=0.25, missed=0.1)
    frames = [noise_of(frame, config) for frame in FRAMES]
    blurred = [noise for noise in frames if noise.blurred]
    assert len(blurred) / len(frames) == pytest.approx(0.3, abs=0.08)
    assert np.mean([noise.flagged for noise in blurred]) == pytest.approx(0.75, abs=0.14)
    assert not any(noise.flagged for noise in frames if not noise.blurred)
    assert np.mean([i.missed for noise in blurred for i in noise.instances]) == pytest.approx(0.2, abs=0.06)


def test_what_is_held_stays_for_an_episode_that_begins_apart() -> None:
    config = only(synonym=0.9, hold=5, mask_pixels=5)
    frames = [noise_of(frame, config) for frame in FRAMES]
    by_thing = {n: [next(i for i in f.instances if i.instance == n) for f in frames] for n in THINGS}
    changes = {n: [a.other_name != b.other_name for a, b in pairwise(s)] for n, s in by_thing.items()}
    for n in THINGS:
        places = np.flatnonzero(changes[n])
        assert len(set((places % 5).tolist())) == 1
        assert len({i.boxes[0].grow for i in by_thing[n][:5]}) == 5
    assert np.flatnonzero(changes[SOFA])[0] % 5 != np.flatnonzero(changes[RUG])[0] % 5


def test_a_frame_is_the_same_in_any_order_and_another_with_another_seed() -> None:
    def told(frame: Frame, seed: int) -> str:
        return repr(noise_of(frame, SimulatedConfig(seed=seed)).instances)

    forward = [told(frame, 3) for frame in FRAMES[:20]]
    assert [told(frame, 3) for frame in reversed(FRAMES[:20])] == forward[::-1]
    assert [told(frame, 4) for frame in FRAMES[:20]] != forward
