"""Labels as prompts: what a detector is asked, and in which order."""

from __future__ import annotations

import random

import numpy as np
import pytest

from uppm.core.types import Label, Provenance
from uppm.perception.segmentation.prompts import detections, pack, phrases, unique_labels

CAPTION, TAG = Provenance.CAPTION, Provenance.TAG
CLS, STOP, SEP = 1, 2, 3


def label(text: str, provenance: Provenance = TAG) -> Label:
    return Label(text=text, provenance=provenance)


def tokenize(word: str) -> list[int]:
    """A token for each two letters."""
    return [100 + ord(word[i]) for i in range(0, len(word), 2)]


def test_prompts_are_sorted_cleaned_and_asked_once() -> None:
    given = [label("TV"), label("chair"), label("tv", CAPTION), label("St. Bernard?"), label(" . "), label("chair")]
    found = unique_labels(given)
    assert list(found) == ["chair", "st bernard", "tv"]
    assert found["tv"] is given[2]
    random.Random(0).shuffle(given)
    assert list(unique_labels(given)) == ["chair", "st bernard", "tv"]


def test_a_label_that_is_no_phrase_is_cut() -> None:
    (text,) = unique_labels([label("very " * 500 + "long")])
    assert len(text.split()) == 24


@pytest.mark.parametrize(
    ("text", "tokens", "head"),
    [("chair", 3, slice(0, 3)), ("red chair", 5, slice(2, 5)), ("cup of tea", 5, slice(0, 2)), ("of", 1, slice(0, 1))],
)
def test_the_head_noun_is_known(text: str, tokens: int, head: slice) -> None:
    (phrase,) = phrases([label(text)], tokenize)
    assert len(phrase.tokens) == tokens
    assert phrase.head == head


def test_phrases_fill_rows_to_the_limit_and_no_further() -> None:
    some = phrases([label(f"item{n:02d}") for n in range(20)], tokenize)
    rows = pack(some, CLS, STOP, SEP, max_tokens=18, together=True)
    assert [len(row.phrases) for row in rows] == [4, 4, 4, 4, 4]
    assert max(len(row.tokens) for row in rows) == 18
    assert [p for row in rows for p in row.phrases] == some
    for row in rows:
        assert (row.tokens[0], row.tokens[-1]) == (CLS, SEP)
        for phrase, start in zip(row.phrases, row.starts, strict=True):
            assert row.tokens[start : start + len(phrase.tokens)] == phrase.tokens
            assert row.tokens[start + len(phrase.tokens)] == STOP
    alone = pack(some, CLS, STOP, SEP, max_tokens=18, together=False)
    assert [len(row.phrases) for row in alone] == [1] * 20


def test_boxes_come_in_pixels_best_first() -> None:
    box = np.array([0.5, 0.5, 0.5, 1.5], dtype=np.float32)
    found = detections([(label("b"), 0.5, box), (label("c"), 0.9, box), (label("a"), 0.5, box)], (40, 80, 3))
    assert [x.text for x in found.labels] == ["c", "a", "b"]
    np.testing.assert_array_equal(found.boxes, [[20, 0, 60, 40]] * 3)
    assert detections([], (40, 80)).boxes.shape == (0, 4)
