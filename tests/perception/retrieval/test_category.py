"""The category table, the prototypes, and both ways to retrieve a category."""

from __future__ import annotations

import csv
import time
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import shared_data
from uppm.core.categories import plain_name, unified_categories
from uppm.core.config import RetrievalConfig
from uppm.core.errors import InputError
from uppm.core.protocols import TextEncoder
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval import category as retrieval
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.embeddings import LabelEmbeddings, shipped_embeddings
from uppm.perception.retrieval.evaluation import evaluate_retrieval, read_labels
from uppm.perception.retrieval.prototypes import lexicon, prototypes
from uppm.perception.retrieval.scores import known_head

DATA = Path(__file__).parent / "data"


class NoEncoder:
    def encode(self, texts: object) -> np.ndarray:
        raise AssertionError(f"the encoder was asked for {texts}")


def test_the_table_is_coco_stuff() -> None:
    categories = unified_categories()
    things = [c for c in categories if c.is_thing]
    assert (len(things), len(categories) - len(things)) == (80, 91)
    assert len({c.id for c in categories}) == len({c.name for c in categories}) == 171
    assert max(c.id for c in things) == 90
    assert [c.id for c in categories if not c.is_thing] == list(range(92, 183))


@pytest.mark.parametrize("run", ["run1", "run2"])
def test_every_category_of_the_flat_is_in_the_table(run: str) -> None:
    names = {c.name for c in unified_categories()}
    with shared_data(f"data/flat/{run}/labels.csv").open(encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            assert set(row["categories"].split("|")) <= names


def test_size_priors_follow_the_extent() -> None:
    size = {c.name: c.voxel_size for c in unified_categories()}
    assert {size[name] for name in ("cup", "book", "fork")} == {0.02}
    assert {size[name] for name in ("chair", "tv", "suitcase")} == {0.03}
    assert {size[name] for name in ("couch", "bed", "table", "refrigerator", "wall-other", "floor-wood")} == {0.05}


def test_a_term_stands_for_one_category_only() -> None:
    owner: dict[str, str] = {}
    for row in prototypes():
        for term in row.terms:
            assert owner.setdefault(term, row.category.name) == row.category.name
    assert [row.category for row in prototypes()] == list(unified_categories())


def test_the_names_of_all_categories_are_retrieved_to_themselves() -> None:
    names = [c.name for c in unified_categories()]
    retriever = create_retriever(RetrievalConfig(method="uppm"), LabelEmbeddings(NoEncoder()))
    assert [c.name for c in retriever.retrieve(names)] == names
    for method in ("paper", "uppm"):
        retriever = create_retriever(RetrievalConfig(method=method), LabelEmbeddings(NoEncoder()))
        assert [c.name for c in retriever.retrieve([plain_name(name) for name in names])] == names


def test_paper_method_is_equation_1(encoder: TextEncoder) -> None:
    labels = ["floor lamp", "desk lamp", "wardrobe", "sofa", "purple thing"]
    names = [c.name for c in unified_categories()]
    cosines = encoder.encode(labels) @ np.stack([shipped_embeddings()[plain_name(name)] for name in names]).T
    found = retrieval.PaperRetriever(encoder).retrieve(labels)
    assert [c.name for c in found] == [names[row] for row in cosines.argmax(axis=1)]
    assert found[0].name == "floor-other"  # the known fault: a floor lamp is no floor


@pytest.mark.parametrize(("name", "left_out"), [("dev", 0.96), ("labels_heldout", 0.96), ("labels_unseen", 0.95)])
def test_accuracy(name: str, left_out: float, embeddings: TextEncoder) -> None:
    """Above the issue's mark, above the paper's way, and not because the lists' own words are in the table."""
    labels = read_labels(DATA / f"{name}.tsv" if name != "dev" else shared_data("data/labels-dev.tsv"))
    ours = evaluate_retrieval(labels, retrieval.PrototypeRetriever(embeddings))
    paper = evaluate_retrieval(labels, retrieval.PaperRetriever(embeddings))
    unforeseen = evaluate_retrieval(labels, retrieval.PrototypeRetriever(embeddings, leave_out=True))
    assert ours.accuracy >= 0.97
    assert unforeseen.accuracy >= left_out
    assert 0.5 < paper.accuracy < 0.80


def test_accuracy_on_phrases_that_the_table_does_not_hold(embeddings: TextEncoder) -> None:
    labels = read_labels(DATA / "labels_compound.tsv")
    assert sum(lemmatize(text) in lexicon() for text, _ in labels) <= 1
    ours = evaluate_retrieval(labels, retrieval.PrototypeRetriever(embeddings)).accuracy
    assert ours >= 0.89
    assert ours > evaluate_retrieval(labels, retrieval.PaperRetriever(embeddings)).accuracy


def test_half_precision_changes_no_category(encoder: TextEncoder) -> None:
    names = [c.name for c in unified_categories()]
    exact = encoder.encode([text for text, _ in read_labels(DATA / "labels_heldout.tsv")][::3])
    table = np.stack([shipped_embeddings()[name] for name in names])
    rounded = exact.astype(np.float16).astype(np.float32)
    assert np.array_equal((rounded @ table.T).argmax(1), (exact @ table.T).argmax(1))


def test_the_head_noun_is_found_before_a_preposition_and_behind_modifiers() -> None:
    assert known_head("old rusty floor lamp") == "floor lamp"
    assert known_head("cup of coffee") == "cup"
    assert known_head("pair of glasses") == "glasses"
    assert known_head("pile of old books") == "book"
    assert known_head("lamp") is None
    assert known_head("") is None


def test_a_head_noun_outweighs_its_modifier(embeddings: TextEncoder) -> None:
    found = retrieval.PrototypeRetriever(embeddings).retrieve(["banana shaped lamp", "car shaped bed"])
    assert [c.name for c in found] == ["light", "bed"]


def test_no_good_category_falls_back_to_the_supercategory() -> None:
    names = [c.name for c in unified_categories()]
    spread = np.zeros(171)
    spread[[names.index(n) for n in ("table", "shelf", "cabinet", "cupboard", "desk-stuff", "counter")]] = 0.12
    spread[names.index("elephant")] = 0.14
    assert retrieval.choose(spread).name == "furniture-other"
    spread[names.index("elephant")] = 0.9
    assert retrieval.choose(spread).name == "elephant"
    animals = np.full(171, 0.001)
    animals[[names.index(n) for n in ("cat", "dog", "bear", "zebra")]] = [0.14, 0.13, 0.12, 0.11]
    assert retrieval.choose(animals).name == "cat"


def test_a_cached_frame_takes_at_most_a_tenth_of_a_millisecond() -> None:
    retriever = retrieval.PrototypeRetriever(LabelEmbeddings(NoEncoder()))
    frame = ["chair", "floor", "wall", "cup", "table"] * 8
    retriever.retrieve(frame)
    times = []
    for _ in range(50):
        start = time.perf_counter()
        retriever.retrieve(frame)
        times.append(time.perf_counter() - start)
    assert min(times) <= 1e-4


@pytest.mark.parametrize("content", ["", "label\tcategories\n", "h\nsofa\n", "h\nsofa\tcouch|sofa\n"])
def test_a_bad_list_is_named(tmp_path: Path, content: str) -> None:
    file = tmp_path / "labels.tsv"
    file.write_text(content)
    with pytest.raises(InputError, match=r"labels\.tsv: expected"):
        read_labels(file)


def test_labels_can_be_categories_of_their_own() -> None:
    retriever = create_retriever(RetrievalConfig(method="labels"), NoEncoder())
    sofa, couch, again = retriever.retrieve(["sofa", "couch", "sofa"])
    assert sofa == again
    assert (sofa.name, couch.name) == ("sofa", "couch")
    assert len({sofa.id, couch.id, *(c.id for c in unified_categories())}) == 173
    assert sofa.voxel_size == couch.voxel_size
    assert max(sofa.id, couch.id) < 1 << 53
