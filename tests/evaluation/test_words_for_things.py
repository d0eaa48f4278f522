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
    # Short of the aim of 0.95 where the map itself has wrong names (docs/retrieval.md).
    assert names.of_a_kind >= (0.95 if profile == "groundtruth" else 0.93), wrong


def test_shares_are_over_names_and_over_things() -> None:
    asked = [
        Asked(name="sofa", thing=1, kind=1, place=1),
        Asked(name="couch", thing=1, kind=1, place=2),
        Asked(name="bed", thing=2, kind=1, place=1),
        Asked(name="chair", thing=3, kind=2, place=2),
        Asked(name="chair", thing=4, kind=2, place=3),
    ]
    metrics = synonym_metrics(asked)
    assert (metrics.unique, metrics.unique_things, metrics.of_a_kind) == (pytest.approx(2 / 3), 0.5, 0.5)
    assert (metrics.names_unique, metrics.names_of_a_kind) == (3, 2)
