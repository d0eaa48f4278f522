"""What WordNet says of a label, and the table that names each category's synsets."""

from __future__ import annotations

from collections import Counter

import pytest

from uppm.core.categories import unified_categories
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.labels.wordnet import names_a_thing, wordnet
from uppm.perception.retrieval.hypernyms import curated_synsets, kind_of
from uppm.perception.retrieval.prototypes import lexicon, prototypes


def best(phrase: str) -> str:
    return unified_categories()[int(kind_of(phrase).evidence.argmax())].name


def test_the_curated_synsets_are_those_of_their_words() -> None:
    table = dict(curated_synsets())
    assert list(table) == [category.name for category in unified_categories()]
    entries = [entry for synsets in table.values() for entry in synsets]
    assert len(entries) > 450
    assert max(Counter(offset for _, offset in entries).values()) == 1
    for word, offset in entries:
        assert offset in {wordnet().synsets[s] for s in wordnet().synsets_of(word)}, word


@pytest.mark.parametrize(
    ("phrase", "category"),
    [
        ("credenza", "cabinet"),
        ("chandelier", "light"),
        ("wardrobe", "cupboard"),
        ("milk carton", "cardboard"),
        ("armchair", "chair"),
        ("poodle", "dog"),
        ("plumber", "person"),
        ("strawberry", "fruit"),
        ("telescope", "solid-other"),
    ],
)
def test_a_noun_is_followed_up_to_its_category(phrase: str, category: str) -> None:
    assert best(phrase) == category


def test_things_come_before_the_people_they_share_a_name_with() -> None:
    doormat = kind_of("doormat").evidence
    names = [category.name for category in unified_categories()]
    assert doormat[names.index("mat")] > doormat[names.index("person")] > 0


def test_a_whole_label_is_told_from_its_head() -> None:
    assert kind_of("floor lamp").whole
    assert not kind_of("purple lamp").whole
    assert best("purple lamp") == "light"
    assert not kind_of("zxcv").evidence.any()
    assert not kind_of("").evidence.any()


def test_wordnet_adds_names_that_the_table_by_hand_does_not_hold() -> None:
    added = [term for row in prototypes() for term in row.wordnet_terms]
    assert len(added) > 250
    assert not any(lemmatize(term) in lexicon() for term in added)
    assert all(all(row.wordnet_glosses) for row in prototypes())


def test_what_can_be_pointed_at() -> None:
    assert all(names_a_thing(noun) for noun in ("chair", "floor lamp", "smartphone", "round table"))
    assert not any(names_a_thing(noun) for noun in ("freedom", "music"))
