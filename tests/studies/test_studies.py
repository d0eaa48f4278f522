"""Studies: the paper's tables are filled rightly, runs are kept, and a small sequence goes through all of it."""

from __future__ import annotations

import json
import re
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from uppm.cli.main import app
from uppm.cli.studies import read_levels
from uppm.core.config import Config
from uppm.core.errors import InputError
from uppm.core.types import Mesh
from uppm.datasets.registry import open_sequence
from uppm.evaluation.error_colors import InstanceError
from uppm.evaluation.ground_truth import load_instances, load_surface_truth
from uppm.evaluation.map_evaluation import Reconstruction
from uppm.evaluation.sampling import SurfacePart
from uppm.regimes.report import write_report
from uppm.regimes.segmentation import evaluate_segmenter
from uppm.regimes.sequence import evaluate_front_end
from uppm.studies.ablation import fill
from uppm.studies.mapping import SharedPerception
from uppm.studies.measure import measure, unified
from uppm.studies.noise import CURVES, METHODS
from uppm.studies.paper_tables import TABLES, VARIANTS
from uppm.studies.report import ablation_report, noise_report
from uppm.studies.runs import Runs

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

    def measured(sequence: Path, config: Config, picture: Path) -> dict[str, Any]:
        asked.append(sequence.name)
        assert picture.parent == tmp_path / "new"
        return {"pq": config.perception.simulated.level}

    file, config = tmp_path / "new" / "runs.json", Config()
    runs = Runs.open(file, measured, resume=True)
    assert (
        runs(Path("a"), config)
        == runs(Path("a"), config)
        == runs(Path("b"), config) | {"picture": runs(Path("a"), config)["picture"]}
    )
    assert runs(Path("a"), config)["pq"] == 1
    assert runs(Path("a"), config)["picture"] != runs(Path("b"), config)["picture"]
    again = Runs.open(file, measured, resume=True)
    again(Path("a"), config)
    again(Path("a"), Config.load(None, ["perception.simulated.level=2"]))
    assert asked == ["a", "b", "a"]
    Runs.open(file, measured, resume=False)(Path("a"), config)
    assert asked == ["a", "b", "a", "a"]
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


def test_without_noise_every_name_of_a_thing_is_asked_and_most_are_found(tmp_path: Path) -> None:
    config = Config.load(None, [*FEW, "perception.simulated.level=0"])
    found = measure(DEMO, config, tmp_path / "map.png")
    text = Path(__file__).resolve().parents[2].joinpath("docs", "evaluation.md").read_text(encoding="utf-8")
    table = text.split("## All keys in one table")[1]
    assert [key for key in found if not re.search(rf"\| `{key}` \|[^|]*\|[^|]*ablation, noise", table)] == []
    assert found["frames"] == 4
    assert found["prompts_present"] > 100
    assert found["prompts_absent"] > 10
    assert 0 < found["query_recall"] <= 1
    assert found["pq_3d"] > 0.1
    green = np.array(InstanceError.RIGHT.value)
    picture = cv2.imread(str(tmp_path / "map.png"))
    assert picture is not None
    drawn = picture[..., ::-1].reshape(-1, 3).astype(float)
    assert ((drawn @ green > 0.98 * np.linalg.norm(drawn, axis=1) * np.linalg.norm(green)).mean()) > 0.02
    assert found["pq"] > 0.9
    noisy = measure(DEMO, Config.load(None, [*FEW, "perception.simulated.level=2"]), tmp_path / "noisy.png")
    assert noisy["pq"] < found["pq"]
    assert noisy["fn"] > found["fn"]


def test_a_run_gives_the_same_figures_and_picture_again(tmp_path: Path) -> None:
    config = Config.load(None, [*FEW, "input.stride=20"])
    once, twice = (measure(DEMO, config, tmp_path / f"{n}.png") for n in range(2))
    assert json.dumps(once) == json.dumps(twice)
    assert (tmp_path / "0.png").read_bytes() == (tmp_path / "1.png").read_bytes()


@pytest.mark.heavy
def test_runs_that_share_perception_find_what_they_find_alone(tmp_path: Path) -> None:
    shared, settings = SharedPerception(), [*FEW, "input.stride=20"]
    for own in ([], ["retrieval.method=labels"], ["fusion.category_policy=same"], ["perception.nms=none"]):
        config = Config.load(None, [*settings, *own])
        together = measure(DEMO, config, tmp_path / "together.png", shared)
        assert json.dumps(together) == json.dumps(measure(DEMO, config, tmp_path / "alone.png"))
        assert (tmp_path / "together.png").read_bytes() == (tmp_path / "alone.png").read_bytes()


def test_a_study_measures_what_the_commands_measure(tmp_path: Path) -> None:
    config = Config.load(None, [*FEW, "input.stride=20"])
    found = measure(DEMO, config, tmp_path / "map.png")
    source, truth = open_sequence(DEMO, config.input), load_surface_truth(DEMO)
    alone = evaluate_front_end(source, truth, config, tmp_path / "alone.uppm")[0]
    # Segments' classes are unified in both; the map's voxels were written and read again in one of them.
    for key in ("accuracy_cm", "completeness_cm", "pq_3d", "map_50", "miou", "object_count_ratio", "frames"):
        assert found[key] == alone[key]
    segments, _ = evaluate_segmenter(source, load_instances(DEMO), config)
    assert [found[key] for key in ("pq", "sq", "rq")] == [segments[key] for key in ("pq", "sq", "rq")]


def test_reports_of_studies_have_tables_curves_and_the_pictures_that_are_there(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed: pip install 'uppm[eval]'")
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((2, 2, 3), np.uint8))
    variants = {name: {**row, "picture": "a.png" if name == "ppm" else "gone.png"} for name, row in figures().items()}
    tables = [fill(table, variants) for table in TABLES]
    write_report(tmp_path, ablation_report("run", "simulated", tables, variants, tmp_path))
    text = (tmp_path / "report.html").read_text()
    assert text.count("image/png") == 1
    assert all(table.title in text for table in TABLES)
    assert "the paper&#x27;s, which were measured on other data: Flat, 762 frames" in text
    assert f"<td>{variants['uppm']['completeness_cm']:.2f} / 1.10</td>" in text
    assert [r["method"] for r in json.loads((tmp_path / "report.json").read_text())["results"]] == list(VARIANTS)

    curve = {key: 0.5 for key, _ in CURVES}
    rows = [
        {"sequence": "run", "method": m, "level": level, "picture": "a.png", **curve}
        for m in METHODS
        for level in (0.0, 1.0)
    ]
    write_report(tmp_path, noise_report(rows, tmp_path))
    text = (tmp_path / "report.html").read_text()
    assert (text.count("image/png"), text.count("image/svg")) == (len(METHODS), 1)
    found = json.loads((tmp_path / "report.json").read_text())["results"]
    assert [(r["method"], r["curve"], r["level"]) for r in found][:2] == [
        ("run: UPPM, noise 0", "UPPM", 0.0),
        ("run: UPPM, noise 1", "UPPM", 1.0),
    ]


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
    assert json.loads((tmp_path / "ablation.json").read_text())["tables"] == tables
    assert (tmp_path / "report.html").read_text().count("image/png") == len(VARIANTS)
