"""Fit the constants of uppm.map.query, say how right each level of `found` is, and judge on lists not fitted on.

Fitted on two sets that count alike: maps of a sequence with ground truth under simulated perception, with three seeds,
asked for every name of the simulated front end and for what is not there (benchmarks/prompts/absent.txt); and the list
tests/map/data/query_fit.tsv of a map's labels with paraphrases. One logistic regression over all pairs of phrase and
submap; a phrase's pairs weigh 1 together for the right ones and 1 together for the wrong ones, so that a large map does
not drown the right answers. For each level from which an answer may be found it says what is right: phrases for what
is there of which something is found, and phrases for what is not there of which nothing is. The level is chosen by hand
(docs/retrieval.md). The weight of looks is not fitted: no weights of such a model could be had. Needs the encoder's
weights:

    python tools/calibrate_query.py flat/run2
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from uppm.bench.query import labeled_submap
from uppm.core.config import Config
from uppm.evaluation.instances import main_instances
from uppm.evaluation.map_evaluation import compare
from uppm.map import query
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval.category import PrototypeRetriever, category_vectors
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.perception.simulated.names import name_table
from uppm.pipeline import map_sequence, open_map, open_sequence
from uppm.regimes.ground_truth import open_truth
from uppm.regimes.reconstructions import map_reconstruction

ROOT = Path(__file__).resolve().parents[1]
DATA, ABSENT = ROOT / "tests" / "map" / "data", ROOT / "benchmarks" / "prompts" / "absent.txt"
SEEDS = (1, 2, 3)
RIDGE = 1e-3
FITTED = slice(0, 3)
"""Columns of the evidence whose weights are fitted."""
LEVELS = np.arange(-1, 4.01, 0.5)
"""Log-odds that are tried for `found`."""
Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Phrase:
    """The evidence (N, 3) of N submaps for one phrase, and which are right (N,)."""

    evidence: Array
    right: npt.NDArray[np.bool_]


def listed(name: str) -> tuple[list[str], list[tuple[str, frozenset[str]]]]:
    """A list's map labels, and its queries with the right labels."""
    _, labels, *rows = [line.split("\t") for line in (DATA / name).read_text(encoding="utf-8").splitlines()]
    queries = [(text, frozenset(lemmatize(label) for label in right.split("|") if label)) for text, right in rows]
    return [lemmatize(label) for label in labels[1].split("|")], queries


def list_index(labels: Sequence[str], encoder: LabelEmbeddings) -> query.SearchIndex:
    """Of a map with one submap a label."""
    categories = PrototypeRetriever(encoder).retrieve(labels)
    submaps = [
        labeled_submap(n, c, [label], [1.0]) for n, (label, c) in enumerate(zip(labels, categories, strict=True))
    ]
    return query.SearchIndex(submaps, dict(zip(labels, encoder.encode(labels), strict=True)), category_vectors())


def list_phrases(name: str, encoder: LabelEmbeddings) -> Iterator[Phrase]:
    labels, queries = listed(name)
    index = list_index(labels, encoder)
    for text, right in queries:
        phrase = lemmatize(text)
        evidence = index.evidence(phrase, encoder.encode([phrase])[0])[0]
        yield Phrase(evidence=evidence[:, FITTED], right=np.array([label in right for label in labels]))


def map_phrases(sequence: Path, seed: int, encoder: LabelEmbeddings) -> Iterator[Phrase]:
    """Phrases for the map of a sequence under simulated perception; what is there but not in the map is left out."""
    config = Config.load(None, ["perception.profile=simulated", f"perception.simulated.seed={seed}"])
    truth = open_truth(sequence)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "map.uppm"
        map_sequence(open_sequence(sequence), file, config)
        panoptic = open_map(file)
        found = compare(map_reconstruction(panoptic, str(file)), truth)
    owners = main_instances(found.samples, found.nearest, truth)
    described = [s for s in panoptic.submaps if s.descriptor and s.descriptor.labels and s.state.value != "tentative"]
    index = query.SearchIndex(described, panoptic.label_embeddings, category_vectors())
    names = {i.id: i.name for i in truth.instances.values()}
    called = [names.get(owners.get(submap.id, 0), "") for submap in described]
    for phrase, meant in asked(set(truth.instance.tolist()), names):
        right = np.array([name in meant for name in called])
        if right.any() or not meant:
            evidence = index.evidence(phrase, encoder.encode([phrase])[0])[0]
            yield Phrase(evidence=evidence[:, FITTED], right=right)


def asked(seen: set[int], names: dict[int, str]) -> Iterator[tuple[str, set[str]]]:
    """Each name of what was seen with the things that it means, and things that are not there."""
    there = {names[number] for number in seen if number in names}
    meant: dict[str, set[str]] = {}
    for thing in there & set(name_table()):
        for text in map(lemmatize, name_table()[thing].names):
            meant.setdefault(text, set()).add(thing)
    yield from meant.items()
    for line in ABSENT.read_text(encoding="utf-8").splitlines():
        yield lemmatize(line), set()


def fit(sets: Sequence[Sequence[Phrase]]) -> Array:
    """Weights of least weighted log loss, with a slight ridge on the slopes; the sets count alike."""
    rows, signs, weights = [], [], []
    for phrases in sets:
        own = [np.where(p.right, 1 / max(p.right.sum(), 1), 1 / max((~p.right).sum(), 1)) for p in phrases]
        total = sum(w.sum() for w in own)
        rows += [p.evidence for p in phrases]
        signs += [np.where(p.right, 1, -1) for p in phrases]
        weights += [w / total for w in own]
    x, sign, weight = np.concatenate(rows), np.concatenate(signs), np.concatenate(weights) / len(sets)

    def loss(w: Array) -> float:
        return float((weight * np.logaddexp(0, -sign * (x @ w))).sum() + RIDGE * (w[1:] ** 2).sum() / 100)

    return minimize(loss, np.zeros(x.shape[1])).x


def right_at(sets: Sequence[Sequence[Phrase]], weights: Array, least: float) -> float:
    """The share of phrases that are right where answers are found from these log-odds on; mean of the sets."""
    shares = []
    for phrases in sets:
        found = np.array([(p.evidence @ weights).max() >= least for p in phrases])
        there = np.array([p.right.any() for p in phrases])
        shares.append((found[there].mean() + (~found[~there]).mean()) / 2)
    return float(np.mean(shares))


def judge(name: str, encoder: LabelEmbeddings) -> dict[str, float | list[tuple[str, str, float]]]:
    """Share of present queries answered right, share of absent ones with nothing found, and the wrong answers."""
    labels, queries = listed(name)
    index = list_index(labels, encoder)
    good: dict[bool, list[bool]] = {True: [], False: []}
    wrong = []
    for text, right in queries:
        phrase = lemmatize(text)
        first = index.rank(phrase, encoder.encode([phrase])[0], closest=1)[0]
        good[bool(right)].append(first.found and first.label in right if right else not first.found)
        if not good[bool(right)][-1]:
            wrong.append((text, first.label, round(first.probability, 2)))
    return {"present": float(np.mean(good[True])), "absent": float(np.mean(good[False])), "wrong": wrong}


def main(sequence: Path, say: Callable[[object], None] = print) -> None:
    encoder = LabelEmbeddings()
    simulated = [phrase for seed in SEEDS for phrase in map_phrases(sequence, seed, encoder)]
    sets = [simulated, list(list_phrases("query_fit.tsv", encoder))]
    weights = fit(sets).round(2)
    query.WEIGHTS = (*weights.tolist(), query.WEIGHTS[3])  # pyright: ignore[reportAttributeAccessIssue]
    say(f"WEIGHTS = {query.WEIGHTS}")
    for least in LEVELS:
        say(f"found from log-odds {least:g}: {right_at(sets, weights, least):.3f} right")
    for name in ("query_fit.tsv", "query_check.tsv"):
        say(f"{name} {judge(name, encoder)}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
