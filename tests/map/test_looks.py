"""Queries of a map with visual features: the text side of their model, and maps that are read without it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from uppm.bench.query import NoVoxels, large_map
from uppm.core.errors import UppmError
from uppm.core.features import VisualFeature
from uppm.core.protocols import TextEncoder
from uppm.core.types import Submap
from uppm.map.looks import PROMPT
from uppm.map.panoptic_map import PanopticMap
from uppm.perception.fakes import FakeTextEncoder
from uppm.perception.retrieval.category import category_vectors

LOOKS = FakeTextEncoder()


class Same:
    """A text encoder to which every phrase is the map's own label."""

    def __init__(self, panoptic: PanopticMap) -> None:
        self._vector = next(iter(panoptic.label_embeddings.values()))

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        return np.stack([self._vector] * len(texts))


def seen_as(submap: Submap, text: str) -> Submap:
    """A submap that looks like a text says."""
    assert submap.descriptor
    feature = VisualFeature(mean=LOOKS.encode([PROMPT.format(text)])[0], count=1)
    return replace(submap, descriptor=replace(submap.descriptor, feature=feature))


def two_of_a_kind(make: Callable[[], TextEncoder]) -> PanopticMap:
    """The third of a large map's objects twice: looking like a plain and like a striped one."""
    made = large_map(3, 1)
    one = made.submaps[2]
    return PanopticMap(
        submaps=[seen_as(one, "plain"), seen_as(replace(one, id=9), "striped")],
        voxels=NoVoxels(),
        encoder=lambda: Same(made),
        category_embeddings=category_vectors,
        look_encoder=make,
        label_embeddings=made.label_embeddings,
    )


def test_how_a_thing_looks_decides_between_things_of_one_name() -> None:
    panoptic = two_of_a_kind(lambda: LOOKS)
    assert [a.submap.id for a in panoptic.rank("plain")] == [3, 9]
    assert [a.submap.id for a in panoptic.rank("striped")] == [9, 3]
    assert panoptic.query("striped").note == ""


def test_without_the_encoder_a_map_is_asked_by_its_words_and_says_so() -> None:
    def missing() -> TextEncoder:
        raise UppmError("torch is not installed")

    panoptic = two_of_a_kind(missing)
    result = panoptic.query("striped")
    assert [a.submap.id for a in panoptic.rank("striped")] == [3, 9]
    assert result.note == "asked without how things look: torch is not installed"
    assert result.to_dict()["note"] == result.note
