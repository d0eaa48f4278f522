"""The rendered flat with ground-truth segments, held to the figures that docs/results.md gives."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.conftest import shared_data
from uppm.cli.main import app


@pytest.mark.heavy
def test_ground_truth_segments_on_the_flat(tmp_path: Path) -> None:
    sequence, file = shared_data("data/flat/run1"), tmp_path / "gts.uppm"
    mapped = CliRunner().invoke(app, ["map", str(sequence), "-o", str(file), "--perception", "groundtruth", "--json"])
    assert mapped.exit_code == 0, mapped.output
    measured = CliRunner().invoke(app, ["evaluate", "map", str(file), "--ground-truth", str(sequence), "--json"])
    found = json.loads(measured.stdout)
    assert found["accuracy_cm"] < 0.545
    assert found["accuracy_along_normal_cm"] < 0.21
    assert found["completeness_cm"] < 0.89
    assert found["completion_ratio_5cm"] > 0.98
    assert found["one_submap_ratio"] >= 0.95
    assert found["things_found"] >= 76
