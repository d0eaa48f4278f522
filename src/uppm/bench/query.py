"""Time of an answer on a large map, apart from the time of embedding the phrase."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from uppm.bench.timing import Clock, figures, load, machine
from uppm.core.errors import UppmError
from uppm.core.types import (
    Category,
    DynamicDescriptor,
    LabelRecord,
    Provenance,
    Submap,
    SubmapKind,
    SubmapState,
    VoxelBlocks,
)
from uppm.map.panoptic_map import PanopticMap
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval.category import category_vectors
from uppm.perception.retrieval.embeddings import LabelEmbeddings, shipped_embeddings
from uppm.perception.retrieval.mpnet import MpnetEncoder
from uppm.perception.retrieval.prototypes import prototypes

ASKED = ("mug", "armchair", "fridge", "desk lamp", "running shoe", "zebra")
"""Asked of the map; their vectors ship, so that no encoder is needed."""
EMBEDDED = ("mug", "something to sit on", "the thing that keeps milk cold", "red bicycle", "violin", "where to sleep")
"""Embedded anew each time."""


class NoVoxels:
    """A map's voxels that nobody may ask for: a query reads none."""

    def blocks(self, submap_id: int) -> VoxelBlocks:
        """Raises `LookupError`."""
        raise LookupError(f"a query read the voxels of submap {submap_id}")


def bench_query(objects: int, labels: int, repeats: int) -> dict[str, Any]:
    """Milliseconds of `PanopticMap.query` with the phrase embedded before, of embedding a phrase that is new, and of
    the first query, which makes the matrices."""
    before = load()
    panoptic = large_map(objects, labels)
    first = Clock()
    with first.frame():
        panoptic.query(ASKED[0])
    for phrase in ASKED:
        panoptic.query(phrase)
    return {
        "objects": objects,
        "labels_an_object": labels,
        "repeats": repeats,
        "query": _times(panoptic.query, ASKED, repeats),
        "first_query_ms": round(1e3 * first.seconds[0], 1),
        "embedding": _embedding(repeats),
        "load_before": before,
        "load_after": load(),
        "machine": machine(),
    }


def _embedding(repeats: int) -> dict[str, float] | str:
    """Of one phrase on the CPU, loading left out; why it could not be measured, where it could not."""
    encoder = MpnetEncoder()
    try:
        encoder.encode(EMBEDDED)
    except UppmError as error:
        return str(error)
    return _times(lambda phrase: encoder.encode([phrase]), EMBEDDED, repeats)


def _times(ask: Callable[[str], object], phrases: Sequence[str], repeats: int) -> dict[str, float]:
    clocks = [Clock() for _ in range(repeats)]
    for clock in clocks:
        for phrase in phrases:
            with clock.frame():
                ask(phrase)
    return {name.replace("_per_frame", ""): value for name, value in figures(clocks).items()}


def large_map(objects: int, labels: int, seed: int = 0) -> PanopticMap:
    """A map of so many objects of all categories in turn, each label a text of its own with a real one's vector."""
    rng = np.random.default_rng(seed)
    rows, shipped = prototypes(), shipped_embeddings()
    submaps, vectors = [], {}
    for n in range(objects):
        row = rows[n % len(rows)]
        terms = [row.terms[k] for k in rng.integers(0, len(row.terms), labels)]
        texts = [f"{term} {n}.{k}" for k, term in enumerate(terms)]
        vectors |= {text: shipped[term] for text, term in zip(texts, terms, strict=True)}
        submaps.append(labeled_submap(n + 1, row.category, texts, rng.uniform(0.1, 1, labels).tolist()))
    return PanopticMap(
        submaps=submaps,
        voxels=NoVoxels(),
        encoder=LabelEmbeddings,
        category_embeddings=category_vectors,
        lemmatize=lemmatize,
        label_embeddings=vectors,
    )


def labeled_submap(number: int, category: Category, texts: Sequence[str], weights: Sequence[float]) -> Submap:
    """An object without geometry, for what looks at labels only."""
    records = tuple(
        LabelRecord(
            text=text,
            category=category.id,
            count=1,
            weight=weight,
            provenance=(Provenance.CAPTION,),
            first_frame=0,
            last_frame=0,
        )
        for text, weight in zip(texts, weights, strict=True)
    )
    return Submap(
        id=number,
        kind=SubmapKind.OBJECT,
        state=SubmapState.CONFIRMED,
        descriptor=DynamicDescriptor(labels=records, category=category, confidence=1.0),
        voxel_size=category.voxel_size,
        truncation=2 * category.voxel_size,
        T_map_submap=np.eye(4),
        first_frame=0,
        last_frame=0,
        views=1,
        misses=0,
        evidence=1.0,
        bounds=np.zeros((2, 3)),
    )
