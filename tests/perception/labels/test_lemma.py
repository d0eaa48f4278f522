"""Normal forms of labels."""

from __future__ import annotations

import pytest

from uppm.core.categories import unified_categories
from uppm.perception.labels.lemma import lemmatize


@pytest.mark.parametrize(
    ("label", "lemma"),
    [
        ("shelves", "shelf"),
        ("mice", "mouse"),
        ("glasses", "glasses"),
        ("The Scissors", "scissors"),
        ("wine glasses", "wine glass"),
        ("tomatoes", "tomato"),
        ("shoes", "shoe"),
        ("vases", "vase"),
        ("boxes", "box"),
        ("benches", "bench"),
        ("brushes", "brush"),
        ("buses", "bus"),
        ("berries", "berry"),
        ("cookies", "cookie"),
        ("women", "woman"),
        ("leaves", "leaf"),
        ("stoves", "stove"),
        ("cactus", "cactus"),
        ("glass", "glass"),
        ("tennis", "tennis"),
        ("window_blinds", "window blind"),
        ("some cups of coffee", "cup of coffee"),
        ("two chairs", "chair"),
        ("reading glasses", "reading glasses"),
        ("a", "a"),
        ("  Two-seat  sofa! ", "two seat sofa"),
        ("chef's knives", "chef's knife"),
        ("", ""),
    ],
)
def test_lemma(label: str, lemma: str) -> None:
    assert lemmatize(label) == lemma


def test_a_lemma_is_its_own_lemma() -> None:
    for category in unified_categories():
        assert lemmatize(lemmatize(category.name)) == lemmatize(category.name)
