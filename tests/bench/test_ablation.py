"""The ablation on a rendered room with a ground-truth surface: that each variant is what it says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.evaluation.test_map_cli import DEMO
from uppm.bench.ablation import VARIANTS
from uppm.cli.main import app
from uppm.core.config import Config

FEW = ["--set", "input.max_frames=7", "--set", "input.stride=5", "--json"]


@pytest.mark.parametrize("name", VARIANTS)
def test_each_variant_changes_what_its_preset_has_otherwise(name: str) -> None:
    preset, changes = VARIANTS[name]
    assert (Config.load(preset, changes) == Config.load("uppm")) == (name == "uppm")


@pytest.mark.heavy
def test_variants_are_measured_on_the_same_frames() -> None:
    wanted = [option for name in ("uppm", "one voxel size, 5 cm", "panmap") for option in ("--variant", name)]
    done = CliRunner().invoke(app, ["bench", "ablation", "--sequence", str(DEMO), *wanted, *FEW])
    assert done.exit_code == 0, done.output
    rows = {row["variant"]: row for row in json.loads(done.output)["rows"]}
    assert [row["frames"] for row in rows.values()] == [7] * 3
    # Coarser voxels take less memory and show less.
    fine, coarse = rows["uppm"], rows["one voxel size, 5 cm"]
    assert coarse["blocks"] < fine["blocks"]
    assert coarse["accuracy_cm"] > fine["accuracy_cm"]
    assert fine["map_mb"] == round(fine["blocks"] * 5632 / 1e6, 1)


def test_an_unknown_variant_names_those_that_are(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "ablation", "--sequence", str(Path("none")), "--variant", "nothing"]
    done = CliRunner().invoke(app, arguments)
    assert "one of: uppm; one voxel size, 2 cm" in str(done.exception)
