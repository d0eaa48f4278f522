"""Ranking submaps for a phrase: on made vectors, and with real embeddings on a map that no constant was fitted on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uppm.core.categories import category_by_name, plain_name, unified_categories
from uppm.core.errors import UppmError
from uppm.core.features import VisualFeature
from uppm.core.types import DynamicDescriptor, LabelRecord, Provenance, Submap, SubmapKind, SubmapState
from uppm.map.query import Answer, SearchIndex
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval.category import PrototypeRetriever, category_vectors
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.perception.retrieval.mpnet import MpnetEncoder
from uppm.perception.retrieval.weights import model_folder

CHECK = Path(__file__).parent / "data" / "query_check.tsv"


def make_submap(number: int, category: str, **weights: float) -> Submap:
    """A submap with labels (underscores for spaces) and their vote weights."""
    unified = category_by_name()[category]
    labels = tuple(
        LabelRecord(
            text=text.replace("_", " "),
            category=unified.id,
            count=max(1, round(weight)),
            weight=weight,
            provenance=(Provenance.DETECTOR,),
            first_frame=0,
            last_frame=1,
        )
        for text, weight in weights.items()
    )
    return Submap(
        id=number,
        kind=SubmapKind.OBJECT,
        state=SubmapState.CONFIRMED,
        descriptor=DynamicDescriptor(labels=labels, category=unified, confidence=1.0),
        voxel_size=unified.voxel_size,
        truncation=0.1,
        T_map_submap=np.eye(4),
        first_frame=0,
        last_frame=1,
        views=2,
        misses=0,
        evidence=1.0,
        bounds=np.zeros((2, 3)),
    )


def rank(
    phrase: str,
    vector: np.ndarray,
    submaps: Sequence[Submap],
    labels: Mapping[str, np.ndarray],
    categories: Mapping[int, np.ndarray],
) -> list[Answer]:
    return SearchIndex(submaps, labels, categories).rank(phrase, vector)


def unit(*values: float) -> np.ndarray:
    vector = np.array(values, dtype=np.float32)
    return vector / np.linalg.norm(vector)


CUP, CHAIR, COUCH = category_by_name()["cup"], category_by_name()["chair"], category_by_name()["couch"]
VECTORS = {"cup": unit(1, 0, 0), "chair": unit(0, 1, 0), "couch": unit(0, 0.6, 0.8)}
CATEGORIES = {CUP.id: VECTORS["cup"], CHAIR.id: VECTORS["chair"], COUCH.id: VECTORS["couch"]}


def test_the_right_submap_is_first_and_probabilities_follow_scores() -> None:
    submaps = [make_submap(1, "cup", cup=3), make_submap(2, "chair", chair=3), make_submap(3, "couch", couch=1)]
    answers = rank("armchair", unit(0, 1, 0.2), submaps, VECTORS, CATEGORIES)
    assert [answer.submap.id for answer in answers] == [2, 3, 1]
    assert answers[0].found
    assert answers[0].label == "chair"
    assert not answers[-1].found
    assert all(answer.probability == pytest.approx(1 / (1 + np.exp(-answer.score))) for answer in answers)
    assert submaps[0].id == 1


def test_the_same_text_is_found_without_an_embedding() -> None:
    first = rank("gizmo", unit(1, 1, 1), [make_submap(1, "solid-other", gizmo=1)], {}, {})[0]
    assert first.found
    assert first.label == "gizmo"
    assert not rank("gizmo", unit(1, 1, 1), [make_submap(1, "solid-other", widget=1)], {}, {})[0].found


def test_a_label_said_once_among_many_counts_less() -> None:
    often = make_submap(1, "chair", chair=9, cup=1)
    always = make_submap(2, "cup", cup=9)
    answers = rank("cup", VECTORS["cup"], [often, always], VECTORS, CATEGORIES)
    assert [answer.submap.id for answer in answers] == [2, 1]
    assert answers[0].score > answers[1].score


def test_a_better_category_that_the_map_lacks_makes_an_answer_improbable() -> None:
    submaps, vector = [make_submap(1, "chair", chair=1)], unit(0, 0.75, 0.66)
    with_couch = rank("sofa", vector, submaps, VECTORS, CATEGORIES)[0]
    without = rank("sofa", vector, submaps, VECTORS, {CHAIR.id: VECTORS["chair"]})[0]
    assert with_couch.probability < without.probability


def test_several_vectors_a_category_are_taken_at_their_best() -> None:
    submaps = [make_submap(1, "couch", couch=1)]
    one = rank("settee", unit(1, 0, 1), submaps, VECTORS, {COUCH.id: VECTORS["couch"], CUP.id: VECTORS["cup"]})
    both = np.stack([VECTORS["couch"], unit(1, 0, 1)])
    two = rank("settee", unit(1, 0, 1), submaps, VECTORS, {COUCH.id: both, CUP.id: VECTORS["cup"]})
    assert two[0].score > one[0].score


def test_submaps_without_labels_are_no_answers_and_equals_go_by_id() -> None:
    free = make_submap(9, "cup")
    submaps = [make_submap(4, "cup", cup=1), free, make_submap(2, "cup", cup=1)]
    answers = rank("cup", VECTORS["cup"], submaps, VECTORS, CATEGORIES)
    assert [answer.submap.id for answer in answers] == [2, 4]
    assert rank("cup", VECTORS["cup"], [], VECTORS, CATEGORIES) == []


def test_only_what_is_asked_for_is_listed() -> None:
    submaps = [make_submap(n, name, **{name: 1}) for n, name in enumerate(("cup", "chair", "chair", "couch"), 1)]
    index = SearchIndex(submaps, VECTORS, CATEGORIES)
    assert [a.submap.id for a in index.rank("cup", VECTORS["cup"], closest=3)] == [1, 2, 3]
    chairs = index.rank("chair", VECTORS["chair"], closest=1)
    assert [a.submap.id for a in chairs] == [a.submap.id for a in index.rank("chair", VECTORS["chair"]) if a.found]
    assert [a.submap.id for a in chairs[:2]] == [2, 3]


def test_plain_names_differ() -> None:
    assert len({plain_name(category.name) for category in unified_categories()}) == 171


def test_real_embeddings_find_paraphrases_and_know_what_is_not_there() -> None:
    """The constants were fitted on another map's labels and on other queries (tools/calibrate_query.py)."""
    try:
        encoder = LabelEmbeddings(MpnetEncoder(model_folder()))
    except UppmError as error:
        pytest.skip(f"no weights: {error}")
    _, labels, *rows = [line.split("\t") for line in CHECK.read_text(encoding="utf-8").splitlines()]
    names = [lemmatize(label) for label in labels[1].split("|")]
    categories = PrototypeRetriever(encoder).retrieve(names)
    submaps = [
        make_submap(n, category.name, **{name: 1})
        for n, (name, category) in enumerate(zip(names, categories, strict=True))
    ]
    known = dict(zip(names, encoder.encode(names), strict=True))
    present, absent = [], []
    for text, right in rows:
        phrase = lemmatize(text)
        first = rank(phrase, encoder.encode([phrase])[0], submaps, known, category_vectors())[0]
        if right:
            present.append(first.found and first.label in [lemmatize(label) for label in right.split("|")])
        else:
            absent.append(not first.found)
    assert np.mean(present) >= 0.9
    assert np.mean(absent) >= 0.85


def test_every_label_of_a_thing_speaks_for_it_in_its_share() -> None:
    both = make_submap(1, "couch", chair=5, couch=5)
    one = make_submap(2, "couch", chair=5, cup=5)
    vector = unit(0, 1, 0.4)
    index = SearchIndex([both, one], VECTORS, {})
    labels = index.evidence("seat", vector)[0][:, 1]
    cosines = np.array([VECTORS[name] @ vector for name in ("chair", "couch")])
    assert labels[0] == pytest.approx(0.1 * np.log((0.5 * np.exp(cosines / 0.1)).sum()), abs=1e-5)
    assert labels[0] > labels[1] > cosines[0] - 0.1
    assert SearchIndex([make_submap(1, "cup", chair=3)], VECTORS, {}).evidence("seat", vector)[0][0, 1] == (
        pytest.approx(cosines[0], abs=1e-5)
    )


def test_a_category_counts_by_its_share_of_the_votes_unless_it_is_pinned() -> None:
    labels = (("cup", CUP), ("chair", CHAIR))
    records = [make_submap(1, c.name, **{name: 1}).descriptor for name, c in labels]
    voted = tuple(record for d in records if d for record in d.labels)
    doubted = replace(make_submap(1, "cup"), descriptor=DynamicDescriptor(labels=voted, category=CUP, confidence=0.5))
    pinned = replace(make_submap(2, "cup"), descriptor=DynamicDescriptor(labels=voted, category=CUP, confidence=1.0))
    couch = unit(0, 0.6, 0.8)
    lag = SearchIndex([doubted, pinned], VECTORS, CATEGORIES).evidence("couch bed", couch)[0][:, 2]
    # Half of the votes are for chairs, which are 0.4 less like it than couches are.
    assert lag[0] == pytest.approx(-0.4 + 0.1 * np.log(0.5), abs=1e-3)
    assert lag[1] == lag[0], "its label speaks for it still"
    named = SearchIndex([pinned], {}, CATEGORIES).evidence("cup", VECTORS["cup"])[0][:, 2]
    assert named == 0


def test_looks_tell_two_things_apart_that_are_called_the_same() -> None:
    red, blue = unit(1, 0), unit(0, 1)
    submaps = []
    for number, look in ((1, blue), (2, red), (3, None)):
        submap = make_submap(number, "chair", chair=1)
        feature = None if look is None else VisualFeature(mean=np.float32(0.5) * look, count=4)
        assert submap.descriptor
        submaps.append(replace(submap, descriptor=replace(submap.descriptor, feature=feature)))
    index = SearchIndex(submaps, VECTORS, CATEGORIES, np.stack([unit(1, 0.1), unit(0.1, 1)]))
    looks = index.evidence("chair", VECTORS["chair"], red)[0][:, 3]
    np.testing.assert_allclose(looks, [-unit(0.1, 1)[1], 0, 0], atol=1e-6)
    assert [a.submap.id for a in index.rank("chair", VECTORS["chair"], look=red)] == [2, 3, 1]
    assert not index.evidence("chair", VECTORS["chair"])[0][:, 3].any()
    blind = SearchIndex(submaps, VECTORS, CATEGORIES)
    assert not blind.evidence("chair", VECTORS["chair"], red)[0][:, 3].any()
