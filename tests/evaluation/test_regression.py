"""The demo scene against benchmarks/regression.json, and twice the same."""

from __future__ import annotations

import json
import runpy
from importlib import resources
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from uppm.cli.main import app

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
regression = SimpleNamespace(**runpy.run_path(str(BENCHMARKS / "regression.py")))


def test_what_counts_as_worse() -> None:
    noted = {"a": {"accuracy_cm": 0.8, "pq_3d": 0.5, "things_found": 20}}
    same = {"a": {"accuracy_cm": 0.84, "pq_3d": 0.48, "things_found": 19}}
    assert regression.differences(noted, same, worse=True) == []
    worse = {"a": {"accuracy_cm": 0.9, "pq_3d": 0.45, "things_found": 18}}
    assert [line.split()[1] for line in regression.differences(noted, worse, worse=True)] == list(noted["a"])
    assert regression.differences(noted, worse, worse=False) == []
    better = {"a": {"accuracy_cm": 0.7, "pq_3d": 0.6, "things_found": 22}}
    assert regression.differences(noted, better, worse=True) == []
    assert len(regression.differences(noted, better, worse=False)) == 3


def test_the_noted_figures_are_those_that_are_measured() -> None:
    noted = json.loads((BENCHMARKS / "regression.json").read_text(encoding="utf-8"))
    assert list(noted) == regression.PERCEPTION.split(",")
    assert all(list(figures) == list(regression.TOLERANCES) for figures in noted.values())


@pytest.mark.heavy
def test_the_demo_has_not_become_worse() -> None:
    noted = json.loads((BENCHMARKS / "regression.json").read_text(encoding="utf-8"))
    assert regression.differences(noted, regression.measure(), worse=True) == []


@pytest.mark.heavy
def test_the_demo_a_second_time_to_the_last_digit() -> None:
    with resources.as_file(resources.files("uppm.data") / "demo") as demo:
        arguments = ["evaluate", "sequence", str(demo), "--perception", "embedded", *regression.OPTIONS, "--json"]
        runs = [json.loads(CliRunner().invoke(app, arguments).stdout) for _ in range(2)]
    for found in runs:
        # What is timed differs, and the folder that the map was in.
        for key in ("frames_per_second", "seconds", "source"):
            del found[key]
    assert runs[0] == runs[1]
