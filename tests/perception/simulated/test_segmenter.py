"""What reaches the map of each kind of noise: masks, labels, what suppression finds to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.perception.simulated.scenes import CHAIR, FLOOR, NAMES, RUG, SOFA, TV, frame_of_things
from tests.perception.simulated.test_noise import only
from uppm.core.config import PerceptionConfig, SimulatedConfig
from uppm.core.errors import ConfigError, InputError
from uppm.core.types import Frame, Label, PanopticSegmentation, Provenance
from uppm.perception.fakes import fake_frame
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.registry import create_segmenter
from uppm.perception.simulated.captioner import SimulatedCaptioner, sentence
from uppm.perception.simulated.names import name_table
from uppm.perception.simulated.segmenter import grounded

EVERYTHING = [text for row in name_table().values() for text in (*row.names, *row.near)]


def prompts(texts: Sequence[str], provenance: Provenance = Provenance.CAPTION) -> list[Label]:
    return [Label(text=text, provenance=provenance) for text in dict.fromkeys(map(lemmatize, texts))]


def segment(
    simulated: SimulatedConfig, texts: Sequence[str] = EVERYTHING, frame: Frame | None = None, nms: str = "custom"
) -> PanopticSegmentation:
    config = PerceptionConfig.model_validate(
        {"profile": "simulated", "simulated": simulated.model_dump(), "nms": nms, "min_mask_pixels": 1}
    )
    return create_segmenter(config).segment(frame or frame_of_things(), prompts(texts))


def region(result: PanopticSegmentation, text: str) -> np.ndarray:
    """(H, W) pixels of all segments of a label."""
    numbers = [n for n, s in enumerate(result.segments, 1) if s.label.text == text]
    return np.isin(result.ids, numbers)


def true_region(*instances: int) -> np.ndarray:
    truth = frame_of_things().truth
    assert truth is not None
    return np.isin(truth.instance, instances)


def test_no_noise_is_the_ground_truth_profile() -> None:
    frame = frame_of_things()
    told = segment(SimulatedConfig(level=0), list(NAMES.values()), frame)
    true = create_segmenter(PerceptionConfig(profile="groundtruth")).segment(frame, ())
    masks = {s.label.text: (true.ids == n, s.score, s.is_thing) for n, s in enumerate(true.segments, 1)}
    assert len(told.segments) == len(masks)
    for n, s in enumerate(told.segments, 1):
        mask, score, thing = masks[{"tv": "TV"}.get(s.label.text, s.label.text)]
        np.testing.assert_array_equal(told.ids == n, mask)
        assert (s.score, s.is_thing) == (score, thing)
    assert told.dropped == true.dropped


def test_what_is_missed_or_not_asked_for_has_no_segment() -> None:
    assert segment(only(missed=1)).segments == ()
    some = segment(only(), ["sofa", "chair"])
    assert {s.label.text for s in some.segments} == {"sofa", "chair"}
    assert some.dropped["simulated_without_prompt"] == 3


def test_a_synonym_finds_what_is_called_otherwise() -> None:
    found = segment(only(), ["couch", "television"])
    assert {s.label.text for s in found.segments} == {"couch", "television"}


def test_wrong_calls_are_labels_of_the_same_masks() -> None:
    result = segment(only(wrong=1))
    near = {lemmatize(text) for name in NAMES.values() for text in name_table()[name].near}
    assert {s.label.text for s in result.segments} <= near
    assert len(result.segments) == len(NAMES)
    regions = [result.ids == n for n in range(1, len(NAMES) + 1)]
    assert any((mask == true_region(SOFA)).all() for mask in regions)


def test_split_things_are_two_segments_that_make_one() -> None:
    result = segment(only(split=1))
    texts = [s.label.text for s in result.segments]
    assert texts.count("sofa") == 2
    assert texts.count("floor") == 1
    np.testing.assert_array_equal(region(result, "sofa"), true_region(SOFA))
    sizes = [np.count_nonzero(result.ids == n) for n, text in enumerate(texts, 1) if text == "sofa"]
    assert min(sizes) > 0.4 * max(sizes)


def test_merged_things_take_the_neighbour_that_they_touch() -> None:
    result = segment(only(merged=1))
    both = [text for text in ("rug", "chair") if region(result, text).any()]
    # The rug is the larger of the two, and comes first.
    assert both == ["rug"]
    np.testing.assert_array_equal(region(result, "rug"), true_region(RUG, CHAIR))
    np.testing.assert_array_equal(region(result, "sofa"), true_region(SOFA))


def test_masks_are_eroded_and_dilated() -> None:
    whole = np.count_nonzero(true_region(TV))
    frames = [frame_of_things(index) for index in range(60)]
    areas = [np.count_nonzero(region(segment(only(mask_pixels=12), frame=f), "tv")) / whole for f in frames]
    assert min(areas) < 0.8
    assert max(areas) > 1.2
    assert np.mean(areas) == pytest.approx(1, abs=0.08)


def test_second_boxes_are_work_for_suppression() -> None:
    noise = only(duplicated=1, synonym=0.9)
    found = [segment(noise, frame=frame_of_things(index)).dropped for index in range(20)]
    assert sum(d.get("near_duplicate_box", 0) for d in found) == 20 * 4
    jittered = noise.model_copy(update={"box_jitter": 0.05})
    some = [segment(jittered, frame=frame_of_things(index)).dropped for index in range(20)]
    # Three of ten lie apart from the first, and are two segments of one object.
    assert 0.55 * 80 < sum(d.get("near_duplicate_box", 0) for d in some) < 0.85 * 80
    assert "near_duplicate_box" not in segment(noise, nms="none").dropped


def test_a_box_inside_another_of_its_name_is_contained() -> None:
    assert segment(only(part=1)).dropped["contained_box"] == 4
    assert len(segment(only(part=1)).segments) == len(NAMES)
    assert len(segment(only(part=1), nms="none").segments) > len(NAMES)


def test_a_false_tag_finds_a_piece_of_what_is_there() -> None:
    config = PerceptionConfig.model_validate({"simulated": only(false_tags=30).model_dump(), "min_mask_pixels": 1})
    frame = frame_of_things()
    tags = SimulatedCaptioner(config).caption(frame).tags
    segmenter = create_segmenter(config.model_copy(update={"profile": "simulated"}))
    result = segmenter.segment(frame, prompts(tags, Provenance.TAG))
    false = [s.label.text for s in result.segments if s.label.text not in map(lemmatize, NAMES.values())]
    assert len(false) > 5
    # In a caption the same words were for what is there, and find nothing else.
    told = segmenter.segment(frame, prompts(tags)).segments
    assert {s.label.text for s in told} <= set(map(lemmatize, NAMES.values()))


def test_a_frame_gives_the_same_whatever_came_before() -> None:
    config = SimulatedConfig(seed=7, level=2)
    forward = [segment(config, frame=frame_of_things(index)) for index in range(6)]
    backward = [segment(config, frame=frame_of_things(index)) for index in reversed(range(6))][::-1]
    for a, b in zip(forward, backward, strict=True):
        np.testing.assert_array_equal(a.ids, b.ids)
        assert a.segments == b.segments


def test_captions_name_what_is_mentioned_and_say_that_a_frame_is_blurred() -> None:
    assert sentence(["sofa", "armchair", "sofa", "bread"]) == "a photo of a sofa, an armchair and bread"
    assert sentence(["sofa"], blurry=True) == "a blurry photo of a sofa"
    assert sentence([]) == "a photo of nothing"
    plain = PerceptionConfig(simulated=SimulatedConfig(level=0))
    caption = SimulatedCaptioner(plain).caption(frame_of_things())
    assert caption.text == "a photo of a sofa, a rug, a TV, a chair and a floor"
    assert caption.tags == ("sofa", "rug", "TV", "chair", "floor")
    nothing = PerceptionConfig(simulated=only(unmentioned=1, untagged=1))
    assert SimulatedCaptioner(nothing).caption(frame_of_things()).tags == ()


@pytest.mark.parametrize(
    ("name", "texts", "found"),
    [
        ("sink with a tap", ["tap", "sink"], "sink"),
        ("TV stand", ["tv"], None),
        ("office chair", ["chair", "office"], "chair"),
        ("office chair", ["chair", "office chair"], "office chair"),
        ("chest of drawers", ["drawer", "chest of drawer", "chest"], "chest"),
    ],
)
def test_a_phrase_is_found_by_its_head(name: str, texts: list[str], found: str | None) -> None:
    assert grounded(name, dict.fromkeys(texts, Provenance.CAPTION)) == found


def test_without_ground_truth_nothing_can_be_simulated() -> None:
    config = PerceptionConfig(profile="simulated")
    with pytest.raises(InputError, match="expected ground truth, found none; simulate on a sequence with instance/"):
        create_segmenter(config).segment(fake_frame(), ())
    with pytest.raises(InputError, match="expected ground truth, found none"):
        SimulatedCaptioner(config).caption(fake_frame())


@pytest.mark.parametrize(("setting", "value"), [("wrong", 1.5), ("hold", 0), ("level", -1), ("seed", "x")])
def test_a_rate_out_of_range_is_named(setting: str, value: object) -> None:
    from uppm.core.config import Config

    with pytest.raises(ConfigError, match=rf"a valid 'perception\.simulated\.{setting}'"):
        Config.load(None, [f"perception.simulated.{setting}={value}"])


def test_an_instance_without_a_row_is_called_by_its_own_name() -> None:
    frame = frame_of_things()
    assert frame.truth is not None
    named = replace(frame, truth=replace(frame.truth, names={**NAMES, FLOOR: "zither"}))
    texts = [s.label.text for s in segment(SimulatedConfig(missed=0), [*EVERYTHING, "zither"], named).segments]
    assert "zither" in texts
