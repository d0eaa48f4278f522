"""Fit the constants of uppm.map.query on tests/map/data/query_fit.tsv, and judge them on query_check.tsv.

Each list holds the labels of one map and queries with the labels that are right, or none where the thing is not there.
One logistic regression over all pairs of query and label; a query's pairs weigh 1 together for the right ones and 1
together for the wrong ones, so that a large map does not drown the right answers. Needs the encoder's weights:

    python tools/calibrate_query.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from uppm.bench.query import labeled_submap
from uppm.core.types import Submap
from uppm.map import query
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval.category import PrototypeRetriever, category_vectors
from uppm.perception.retrieval.embeddings import LabelEmbeddings

DATA = Path(__file__).resolve().parents[1] / "tests" / "map" / "data"
RIDGE = 1e-3


def read_queries(name: str) -> tuple[list[str], list[tuple[str, frozenset[str]]]]:
    """A list's map labels, and its queries with the right labels."""
    _, labels, *rows = [line.split("\t") for line in (DATA / name).read_text(encoding="utf-8").splitlines()]
    queries = [(text, frozenset(lemmatize(label) for label in right.split("|") if label)) for text, right in rows]
    return [lemmatize(label) for label in labels[1].split("|")], queries


def make_submaps(labels: list[str], encoder: LabelEmbeddings) -> list[Submap]:
    """One submap a label, seen with this label only."""
    categories = PrototypeRetriever(encoder).retrieve(labels)
    return [
        labeled_submap(number, category, [label], [1.0])
        for number, (label, category) in enumerate(zip(labels, categories, strict=True), 1)
    ]


def make_index(labels: list[str], encoder: LabelEmbeddings) -> query.SearchIndex:
    """Of a map with these labels."""
    known = dict(zip(labels, encoder.encode(labels), strict=True))
    return query.SearchIndex(make_submaps(labels, encoder), known, category_vectors())


def pairs(name: str, encoder: LabelEmbeddings) -> tuple[npt.NDArray[np.float64], ...]:
    """Features (P, 3) with the constant first, truth (P,) and weight (P,) of all pairs of a list."""
    labels, queries = read_queries(name)
    index = make_index(labels, encoder)
    rows, truth, weight = [], [], []
    for text, right in queries:
        phrase = lemmatize(text)
        rows.append(index.evidence(phrase, encoder.encode([phrase])[0])[0])
        for label in labels:
            truth.append(label in right)
            weight.append(1 / len(right) if label in right else 1 / (len(labels) - len(right)))
    return np.concatenate(rows), np.array(truth, dtype=np.float64), np.array(weight)


def fit(
    features: npt.NDArray[np.float64], truth: npt.NDArray[np.float64], weight: npt.NDArray[np.float64]
) -> list[float]:
    """Weights of least weighted log loss, with a slight ridge on the slopes."""

    def loss(w: npt.NDArray[np.float64]) -> float:
        margin = np.where(truth > 0, 1, -1) * (features @ w)
        return float((weight * np.logaddexp(0, -margin)).sum() / weight.sum() + RIDGE * (w[1:] ** 2).sum() / 100)

    return [round(float(value), 2) for value in minimize(loss, np.zeros(features.shape[1])).x]


def judge(name: str, encoder: LabelEmbeddings) -> dict[str, float | list[tuple[str, str, float]]]:
    """Share of present queries answered right, share of absent ones with nothing found, and the wrong answers."""
    labels, queries = read_queries(name)
    index = make_index(labels, encoder)
    good: dict[bool, list[bool]] = {True: [], False: []}
    wrong = []
    for text, right in queries:
        phrase = lemmatize(text)
        first = index.rank(phrase, encoder.encode([phrase])[0], closest=1)[0]
        good[bool(right)].append(first.found and first.label in right if right else not first.found)
        if not good[bool(right)][-1]:
            wrong.append((text, first.label, round(first.probability, 2)))
    return {"present": float(np.mean(good[True])), "absent": float(np.mean(good[False])), "wrong": wrong}


def main() -> None:
    encoder = LabelEmbeddings()
    query.WEIGHTS = tuple(fit(*pairs("query_fit.tsv", encoder)))  # pyright: ignore[reportAttributeAccessIssue]
    print(f"WEIGHTS = {query.WEIGHTS}")
    for name in ("query_fit.tsv", "query_check.tsv"):
        print(name, judge(name, encoder))


if __name__ == "__main__":
    main()
