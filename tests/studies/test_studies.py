"""Studies: the paper's tables are filled rightly, runs are kept, and a small sequence goes through all of it."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from uppm.cli.main import app
from uppm.cli.studies import read_levels
from uppm.core.config import Config
from uppm.core.errors import InputError
from uppm.core.types import Mesh
from uppm.evaluation.map_evaluation import Reconstruction
from uppm.evaluation.sampling import SurfacePart
from uppm.studies.ablation import fill
from uppm.studies.measure import measure, unified
from uppm.studies.noise import CURVES, METHODS, draw_curves
from uppm.studies.paper_tables import TABLES, VARIANTS
from uppm.studies.runs import Runs
from uppm.studies.segments import measure_segments

DEMO = Path(str(resources.files("uppm.data"))) / "demo"
FEW = ["perception.profile=simulated", "input.stride=10", "perception.min_mask_pixels=40"]


def figures() -> dict[str, dict[str, Any]]:
    """Invented ones, another for each variant and metric."""
    keys = sorted({c.key for table in TABLES for c in table.columns})
    return {v: {key: 1.0 + i + j / 10 for j, key in enumerate(keys)} for i, v in enumerate(VARIANTS)}


def test_every_row_of_a_table_has_its_variant_and_the_papers_figures_fit() -> None:
    for table in TABLES:
        for row in table.rows:
            assert {row.variant, row.against or row.variant} <= set(VARIANTS)
            assert len(row.paper) <= len(table.columns)
    for settings in VARIANTS.values():
        Config.load(None, settings)


def test_the_papers_table_of_unified_semantics_has_its_rows_and_columns() -> None:
    rows = fill(TABLES[0], figures())
    assert [row["row"] for row in rows] == ["UPPM", "UPPM with tags", "PPM", "PPM with tags"]
    assert rows[0]["paper"] == {"completeness_cm": 1.1, "accuracy_cm": 0.61, "chamfer_cm": 2.64}
    assert rows[2]["ours"]["accuracy_cm"] == figures()["ppm"]["accuracy_cm"]


def test_changes_are_differences_or_percent() -> None:
    given = figures()
    given["ppm"] |= {"chamfer_cm": 2.0, "completion_ratio_5cm": 0.9}
    given["ppm, no NMS"] |= {"chamfer_cm": 2.5, "completion_ratio_5cm": 0.8}
    enhancement = fill(TABLES[1], given)[-1]
    assert enhancement["change"]
    assert enhancement["ours"] == pytest.approx({"chamfer_cm": -0.5, "completion_ratio_5cm": 10})
    given["uppm"] |= {"tp": 300, "fn": 50}
    given["uppm, no NMS"] |= {"tp": 200, "fn": 100}
    improvement = fill(TABLES[2], given)[-1]["ours"]
    assert (improvement["tp"], improvement["fn"]) == (50.0, -50.0)
    given["uppm, no NMS"] |= {"tp": 0, "fn": None}
    improvement = fill(TABLES[2], given)[-1]["ours"]
    assert (improvement["tp"], improvement["fn"]) == (None, None)


def test_runs_are_measured_once_and_kept(tmp_path: Path) -> None:
    asked: list[str] = []

    def measured(sequence: Path, config: Config) -> dict[str, Any]:
        asked.append(sequence.name)
        return {"pq": config.perception.simulated.level}

    file, config = tmp_path / "new" / "runs.json", Config()
    runs = Runs.open(file, measured, resume=True)
    assert runs(Path("a"), config) == runs(Path("a"), config) == {"pq": 1.0}
    again = Runs.open(file, measured, resume=True)
    again(Path("a"), config)
    again(Path("a"), Config.load(None, ["perception.simulated.level=2"]))
    assert asked == ["a", "a"]
    Runs.open(file, measured, resume=False)(Path("a"), config)
    assert asked == ["a", "a", "a"]
    file.write_text("{")
    with pytest.raises(InputError, match="expected the runs of a study"):
        Runs.open(file, measured, resume=True)


def test_labels_are_compared_under_unified_categories() -> None:
    empty = Mesh(
        vertices=np.zeros((0, 3), np.float32), normals=np.zeros((0, 3), np.float32),
        colors=np.zeros((0, 3), np.uint8), faces=np.zeros((0, 3), np.int32),
    )  # fmt: skip
    parts = [
        SurfacePart(id=n, mesh=empty, category=c) for n, c in enumerate(["settee", "couch", None, "wall-other"], 1)
    ]
    found = unified(Reconstruction(source="x", parts=tuple(parts))).parts
    assert [part.category for part in found] == ["couch", "couch", None, "wall-other"]


def test_levels_are_read_or_refused() -> None:
    assert read_levels("0,0.5, 2") == [0, 0.5, 2]
    for text in ("", "1,x", "-1", "nan"):
        with pytest.raises(InputError, match="--levels: expected numbers from 0 on"):
            read_levels(text)


def test_without_noise_every_name_of_a_thing_is_asked_and_most_are_found() -> None:
    config = Config.load(None, [*FEW, "perception.simulated.level=0"])
    found = measure(DEMO, config)
    assert found["frames"] == 4
    assert found["prompts_present"] > 100
    assert found["prompts_absent"] > 10
    assert 0 < found["query_recall"] <= 1
    assert found["pq_3d"] > 0.1
    segments = measure_segments(DEMO, config)
    assert segments["pq"] > 0.9
    noisy = measure_segments(DEMO, Config.load(None, [*FEW, "perception.simulated.level=2"]))
    assert noisy["pq"] < segments["pq"]
    assert noisy["fn"] > segments["fn"]


def test_curves_are_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed: pip install 'uppm[eval]'")
    rows = [
        {"sequence": "run", "method": m, "level": level, **{key: 1 - level / 4 for key, _ in CURVES}}
        for m in METHODS
        for level in (0.0, 1.0)
    ]
    draw_curves(rows, tmp_path / "noise.png")
    assert (tmp_path / "noise.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.heavy
def test_the_ablation_of_the_demo_goes_through_and_on(tmp_path: Path) -> None:
    arguments = ["evaluate", "ablation", str(DEMO), "-o", str(tmp_path), "--set", FEW[1], "--set", FEW[2], "--json"]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    tables = json.loads(result.stdout)["tables"]
    assert [len(table["rows"]) for table in tables] == [len(table.rows) for table in TABLES]
    assert tables[0]["rows"][0]["ours"]["completeness_cm"] > 0
    again = CliRunner().invoke(app, [*arguments, "--resume"], catch_exceptions=False)
    assert json.loads(again.stdout)["tables"] == tables
    assert set(json.loads((tmp_path / "ablation.json").read_text())["variants"]) == set(VARIANTS)
