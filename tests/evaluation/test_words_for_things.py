"""Words for the things of the rendered flat: what is there is found by every name, what is not there is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import shared_data
from uppm.core.config import Config
from uppm.evaluation.instances import main_instances
from uppm.evaluation.language import language_metrics
from uppm.evaluation.map_evaluation import compare
from uppm.evaluation.prompts import meant_instances, read_prompts
from uppm.pipeline import map_sequence, open_map, open_sequence
from uppm.regimes.ground_truth import open_truth
from uppm.regimes.query import ask
from uppm.regimes.reconstructions import map_reconstruction
from uppm.regimes.synonyms import Asked, ask_names, synonym_metrics

PROMPTS = Path(__file__).resolve().parents[2] / "benchmarks" / "prompts" / "flat.tsv"


@pytest.mark.heavy
@pytest.mark.parametrize("profile", ["groundtruth", "simulated"])
def test_names_and_prompts_on_the_flat(profile: str, tmp_path: Path) -> None:
    """Constants were fitted on the other visit and another map (tools/calibrate_query.py)."""
    sequence, file = shared_data("data/flat/run1"), tmp_path / "flat.uppm"
    map_sequence(open_sequence(sequence), file, Config.load(None, [f"perception.profile={profile}"]))
    panoptic, truth = open_map(file), open_truth(sequence)
    found = compare(map_reconstruction(panoptic, str(file)), truth)
    owners = main_instances(found.samples, found.nearest, truth)
    prompts = read_prompts(PROMPTS)
    metrics = language_metrics(ask(panoptic, prompts, meant_instances(prompts, truth, owners, str(PROMPTS))))
    assert metrics.query_auroc_absent is not None
    assert metrics.query_auroc_absent >= 0.95
    assert (metrics.query_top1 or 0) >= 0.9
    assert (metrics.query_false_answers or 0) <= 0.15
    asked = ask_names(panoptic, truth, owners)
    wrong = [(a.name, truth.instances[a.thing].name, a.kind, a.place) for a in asked if not a.right]
    names = synonym_metrics(asked)
    assert names.unique >= 0.95, wrong
    # Short of the aim of 0.95 where the map itself has wrong names; the query's part is in the last two lines.
    assert names.of_a_kind >= (0.95 if profile == "groundtruth" else 0.93), wrong
    assert names.known_unique >= 0.95, wrong
    assert names.known_of_a_kind >= 0.95, wrong


@pytest.mark.heavy
def test_names_on_the_second_visit(tmp_path: Path) -> None:
    """Half as many views, so that wrong names win more votes: what is asked is what the map has for what it is."""
    sequence, file = shared_data("data/flat/run2"), tmp_path / "flat.uppm"
    map_sequence(open_sequence(sequence), file, Config.load(None, ["perception.profile=simulated"]))
    panoptic, truth = open_map(file), open_truth(sequence)
    found = compare(map_reconstruction(panoptic, str(file)), truth)
    names = synonym_metrics(ask_names(panoptic, truth, main_instances(found.samples, found.nearest, truth)))
    assert names.known_unique >= 0.95
    assert names.known_of_a_kind >= 0.95


def asked_of(name: str, thing: int, kind: int, place: int, *, known: bool = True, called: int = 1) -> Asked:
    return Asked(name=name, thing=thing, kind=kind, place=place, known=known, called=called)


def test_shares_are_over_names_and_over_things() -> None:
    asked = [
        asked_of("sofa", 1, 1, 1),
        asked_of("couch", 1, 1, 2, called=2),  # A wall that the map calls a couch comes first.
        asked_of("bed", 2, 1, 1),
        asked_of("lamp", 5, 1, 9, known=False),  # A vase to the map.
        asked_of("chair", 3, 2, 2),
        asked_of("chair", 4, 2, 3),
    ]
    metrics = synonym_metrics(asked)
    assert (metrics.unique, metrics.unique_things, metrics.of_a_kind) == (0.5, pytest.approx(1 / 3), 0.5)
    assert (metrics.known_unique, metrics.known_of_a_kind) == (1.0, 0.5)
    assert (metrics.names_unique, metrics.names_of_a_kind) == (4, 2)
