"""`uppm evaluate map` on a map file made by the pipeline."""

from __future__ import annotations

import json
import shutil
from dataclasses import fields
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import uppm
from uppm.cli.evaluate import evaluate_app
from uppm.core.errors import InputError
from uppm.evaluation.instances import InstanceMetrics
from uppm.evaluation.panmap_metrics import PanmapMetrics

DEMO = Path(str(resources.files("uppm.data").joinpath("demo")))


@pytest.fixture(scope="module")
def truth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's ground truth, every eighth point: what is far from six frames' map takes long to measure."""
    folder = tmp_path_factory.mktemp("truth")
    shutil.copyfile(DEMO / "labels.csv", folder / "labels.csv")
    with np.load(DEMO / "surface.npz") as surface:
        np.savez(folder / "surface.npz", xyz_mm=surface["xyz_mm"][::8], instance=surface["instance"][::8])
    return folder


@pytest.fixture(scope="module")
def map_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six frames of the demo, with the instances known."""
    path = tmp_path_factory.mktemp("map") / "demo.uppm"
    config = uppm.Config.load(None, ["perception.profile=groundtruth", "input.max_frames=6"])
    uppm.map_sequence(uppm.open_sequence(DEMO, config.input), path, config)
    return path


def test_a_map_of_known_instances(map_file: Path, truth: Path) -> None:
    arguments = ["map", str(map_file), "--ground-truth", str(truth), "--json", "--min-pixels", "500"]
    result = CliRunner().invoke(evaluate_app, arguments)
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    wanted = {field.name for kind in (InstanceMetrics, PanmapMetrics) for field in fields(kind)}
    assert wanted <= set(found)
    qualities = {f"{q}_3d{of}" for q in ("pq", "rq", "sq") for of in ("", "_things", "_stuff")}
    assert qualities | {"map_50", "miou", "fw_iou", "classes_excluded"} <= set(found)
    assert not {"pq", "rq", "sq", "pq_things"} & set(found)
    # Six frames see the table with its chairs well, and little else.
    assert found["accuracy_cm"] < 2.5
    assert found["precision_5cm"] > 0.98
    assert found["completion_ratio_5cm"] < 0.7
    assert found["category_accuracy"] > 0.9
    table = next(match for match in found["matches"] if match["name"] == "dining table")
    assert len(table["submaps"]) == len(table["right_category"]) == 1
    assert found["per_class"]["dining table"]["fp"] == 0


def test_every_key_is_documented(map_file: Path, truth: Path) -> None:
    arguments = ["map", str(map_file), "--ground-truth", str(truth), "--json", "--points-per-m2", "400"]
    found = json.loads(CliRunner().invoke(evaluate_app, arguments).stdout)
    documentation = Path(__file__).resolve().parents[2].joinpath("docs", "evaluation.md").read_text(encoding="utf-8")
    assert [key for key in found if f"`{key}`" not in documentation] == []


def test_a_table_of_map_and_mesh(map_file: Path, truth: Path, tmp_path: Path) -> None:
    import trimesh

    mesh = uppm.open_map(map_file).mesh()
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(tmp_path / "mesh.ply")
    paths = [str(map_file), str(tmp_path / "mesh.ply")]
    arguments = ["map", *paths, "--ground-truth", str(truth), "--points-per-m2", "400"]
    shown = CliRunner().invoke(evaluate_app, [*arguments])
    assert shown.exit_code == 0, shown.output
    # However narrow the terminal, the metrics' names are whole.
    assert all(f"│ {name} " in shown.stdout for name in ("pq_3d", "accuracy_along_normal_cm", "ground_truth_points"))
    listed = json.loads(CliRunner().invoke(evaluate_app, [*arguments, "--json"]).stdout)
    # One surface, sampled twice.
    assert listed[0]["accuracy_cm"] == pytest.approx(listed[1]["accuracy_cm"], rel=0.02)
    assert "pq_3d" not in listed[1]


def test_a_map_file_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "map.uppm").write_bytes(b"not a database")
    result = CliRunner().invoke(evaluate_app, ["map", str(tmp_path / "map.uppm"), "--ground-truth", str(DEMO)])
    assert isinstance(result.exception, InputError)
    assert "map.uppm" in str(result.exception)
