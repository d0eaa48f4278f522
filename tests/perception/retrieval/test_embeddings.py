"""Vectors that are computed once: shipped, kept in the map, or made now."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uppm.perception.retrieval import embeddings as module
from uppm.perception.retrieval.mpnet import MpnetEncoder


class CountingEncoder:
    def __init__(self) -> None:
        self.asked: list[str] = []

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        self.asked += texts
        return np.eye(768, dtype=np.float32)[[len(text) for text in texts]]


def test_the_shipped_table_holds_what_it_must() -> None:
    assert set(module.shipped_embeddings()) == set(module.shipped_texts())


def test_the_shipped_table_is_what_the_tool_makes(encoder: MpnetEncoder) -> None:
    """One vector in sixty; the whole takes minutes."""
    texts = module.shipped_texts()[::60]
    vectors, made = np.stack([module.shipped_embeddings()[text] for text in texts]), encoder.encode(texts)
    assert np.abs(vectors - made).max() < 2e-4
    assert (vectors * made).sum(axis=1).min() > 0.99999


def test_a_text_is_encoded_once_in_a_maps_life() -> None:
    encoder = CountingEncoder()
    labels = module.LabelEmbeddings(encoder)
    first = labels.encode(["zxcv", "couch", "zxcv", "qwertz"])
    assert encoder.asked == ["zxcv", "qwertz"]
    assert np.array_equal(first[0], first[2])
    assert np.array_equal(labels.encode(["qwertz", "zxcv"])[1], first[0])
    assert encoder.asked == ["zxcv", "qwertz"]
    assert np.array_equal(first[1], module.shipped_embeddings()["couch"])


def test_what_is_new_is_told_once_and_survives_in_the_next_session() -> None:
    labels = module.LabelEmbeddings(CountingEncoder())
    labels.encode(["zxcv", "couch"])
    new = labels.take_new()
    assert set(new) == {"zxcv", "couch"}
    labels.encode(["couch", "bed"])
    assert set(labels.take_new()) == {"bed"}
    resumed = CountingEncoder()
    again = module.LabelEmbeddings(resumed, known=new)
    assert np.array_equal(again.encode(["zxcv"])[0], new["zxcv"])
    assert (resumed.asked, again.take_new()) == ([], {})


def test_no_text_gives_no_rows() -> None:
    assert module.LabelEmbeddings(CountingEncoder()).encode([]).shape == (0, 768)


def test_every_label_of_the_embedded_profile_ships() -> None:
    from uppm.core.categories import unified_categories

    things = [category.name for category in unified_categories() if category.is_thing]
    assert set(things) | {"floor", "wall", "ceiling", "table", "furniture", "object", "door", "window"} <= set(
        module.shipped_embeddings()
    )


def test_a_table_is_written_the_same_twice(tmp_path) -> None:
    vectors = np.random.default_rng(0).normal(size=(2, 768)).astype(np.float32)
    for name in ("a.npz", "b.npz"):
        module.write_table(tmp_path / name, ["couch", "tv"], vectors)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
