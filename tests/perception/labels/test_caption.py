"""Captions and tags as models write them, and the labels that a person would take from them."""

from __future__ import annotations

from pathlib import Path

import pytest

from uppm.core.config import PerceptionConfig
from uppm.core.errors import ConfigError
from uppm.core.language import Caption
from uppm.core.types import Provenance
from uppm.perception.fakes import FakeCaptioner, fake_frame
from uppm.perception.labels.caption import BLURRED, NO_THING, CaptionLabeler, is_blurry, parse_caption
from uppm.perception.labels.tagger import tagger
from uppm.perception.registry import create_labeler

DATA = Path(__file__).parent / "data"


def read_table(name: str) -> list[list[str]]:
    return [line.split("\t") for line in (DATA / name).read_text(encoding="utf-8").splitlines()[1:]]


def labels_of(text: str) -> list[str]:
    return [label.text for label in parse_caption(Caption(text=text)).labels]


@pytest.mark.parametrize(("table", "captions"), [("captions_dev.tsv", 100), ("captions_heldout.tsv", 50)])
def test_of_all_phrases_at_least_95_percent_are_right(table: str, captions: int) -> None:
    """Right: in both sets. Missing and surplus phrases both count against it."""
    rows = read_table(table)
    assert len(rows) == captions
    pairs = [(set(expected.split("|")), set(labels_of(caption))) for caption, expected in rows]
    right = sum(len(expected & found) for expected, found in pairs)
    assert right / sum(len(expected | found) for expected, found in pairs) >= 0.95


def test_tags_are_those_of_nltk() -> None:
    """NLTK 3.10.4's PerceptronTagger with the same weights."""
    for words, tags in read_table("tags_nltk.tsv"):
        assert tagger().tag(words.split()) == tags.split()
    assert tagger().tag([]) == []


@pytest.mark.parametrize(
    ("caption", "labels"),
    [
        ("a red armchair next to a floor lamp", ["red armchair", "floor lamp"]),
        ("a cup and a book on a table", ["cup", "book", "table"]),
        ("a cup of coffee", ["cup of coffee"]),
        ("a pair of shoes", ["shoe"]),
        ("a bowl of fruit", ["bowl of fruit"]),
        ("a painting of a woman", ["painting"]),
        ("the door of the cabinet", ["door", "cabinet"]),
        ("shelves and mice", ["shelf", "mouse"]),
        ("a trash can", ["trash can"]),
        ("a black and white cat", ["black and white cat"]),
        ("two glasses", ["glass"]),
        ("the top of a counter top", ["counter top"]),
        ("a couple of photos of a room", []),
        ("", []),
        ("...", []),
    ],
)
def test_kinds_of_phrases(caption: str, labels: list[str]) -> None:
    assert labels_of(caption) == labels


def test_each_label_says_where_it_came_from() -> None:
    found = parse_caption(
        Caption(text="a wooden desk", tags=("wooden desk", "Shelves", "sit", "red", "room", "smartphone"))
    )
    assert [(label.text, label.provenance) for label in found.labels] == [
        ("wooden desk", Provenance.CAPTION),
        ("shelf", Provenance.TAG),
        ("smartphone", Provenance.TAG),
    ]
    assert found.dropped == {NO_THING: 3}


def test_tags_can_be_left_out() -> None:
    caption = Caption(text="a desk", tags=("chair",))
    assert [label.text for label in parse_caption(caption, use_tags=False).labels] == ["desk"]


@pytest.mark.parametrize("text", ["a blurry photo of a desk", "Blurred image.", "the picture is out of focus"])
def test_a_frame_that_its_caption_calls_blurry_is_skipped(text: str) -> None:
    assert is_blurry(text)
    captioner = FakeCaptioner(text, ["desk"])
    assert CaptionLabeler(captioner).label(fake_frame()).skip == BLURRED
    kept = CaptionLabeler(captioner, skip_blurry=False).label(fake_frame())
    assert kept.skip is None
    assert "desk" in [label.text for label in kept.labels]


def test_sharp_captions_are_not_blurry() -> None:
    assert not any(is_blurry(caption) for caption, _ in read_table("captions_dev.tsv") if "blurry" not in caption)


def test_closing_the_labeler_closes_its_captioner() -> None:
    class Heavy(FakeCaptioner):
        closed = 0

        def close(self) -> None:
            self.closed += 1

    heavy = Heavy("a desk")
    CaptionLabeler(heavy).close()
    CaptionLabeler(FakeCaptioner("a desk")).close()
    assert heavy.closed == 1


def test_the_captioner_is_chosen_by_name() -> None:
    assert create_labeler(PerceptionConfig()).label(fake_frame()).labels == ()
    with pytest.raises(ConfigError, match=r"perception\.captioner"):
        create_labeler(PerceptionConfig(captioner="nothing"))
