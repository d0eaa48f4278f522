from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner, Result

from tests.evaluation.scenes import grid, write_truth
from uppm.cli.evaluate import evaluate_app
from uppm.core.errors import InputError

KEYS = {
    "accuracy_along_normal_cm",
    *("accuracy_cm", "completeness_cm", "chamfer_l1_cm", "chamfer_l1_half_cm", "chamfer_squared_cm2", "chamfer_cm"),
    *(
        "hausdorff_cm",
        "hausdorff_95_cm",
        "completion_ratio_5cm",
        "precision_5cm",
        "recall_5cm",
        "f1_5cm",
        "f1_foreground_5cm",
    ),
    *("method", "aligned", "misalignment_cm", "misalignment_deg", "notes"),
    *("source", "ground_truth", "points_per_m2", "seed", "reconstruction_points", "ground_truth_points"),
}


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    return write_truth(tmp_path / "sequence", {1: grid(0, 0, 0, side=2, step=0.02), 2: grid(0.5, 0.5, 0.5, side=0.2)})


def plane(tmp_path: Path, name: str = "plane.ply", height: float = 0.02, scale: float = 1.0) -> Path:
    vertices = scale * np.array([[0, 0, height], [2, 0, height], [2, 2, height], [0, 2, height]])
    trimesh.Trimesh(vertices, [[0, 1, 2], [0, 2, 3]], process=False).export(tmp_path / name)
    return tmp_path / name


def run(*arguments: object) -> Result:
    return CliRunner().invoke(evaluate_app, ["map", *map(str, arguments)])


def failure(*arguments: object) -> str:
    result = run(*arguments)
    assert isinstance(result.exception, InputError), result.output
    assert "\n" not in str(result.exception)
    return str(result.exception)


def test_json_of_a_mesh(tmp_path: Path, sequence: Path) -> None:
    result = run(plane(tmp_path), "--ground-truth", sequence, "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert set(found) == KEYS
    assert found["accuracy_cm"] == pytest.approx(2.15, abs=0.1)
    assert found["chamfer_l1_cm"] == pytest.approx(found["accuracy_cm"] + found["completeness_cm"])
    assert found["completion_ratio_5cm"] == pytest.approx(10000 / 10400)
    assert found["reconstruction_points"] == 40_000
    assert found["f1_foreground_5cm"] == 0


def test_a_second_run_prints_the_same(tmp_path: Path, sequence: Path) -> None:
    mesh = plane(tmp_path)
    first, second = (run(mesh, "--ground-truth", sequence, "--json", "--seed", "3") for _ in range(2))
    assert first.stdout == second.stdout
    other = run(mesh, "--ground-truth", sequence, "--json", "--seed", "4")
    assert other.stdout != first.stdout


def test_density(tmp_path: Path, sequence: Path) -> None:
    result = run(plane(tmp_path), "--ground-truth", sequence, "--json", "--points-per-m2", "100")
    assert json.loads(result.stdout)["reconstruction_points"] == 400


def test_several_in_one_table(tmp_path: Path, sequence: Path) -> None:
    meshes = plane(tmp_path), plane(tmp_path, "other.glb", height=0.06)
    listed = json.loads(run(*meshes, "--ground-truth", sequence, "--json").stdout)
    assert [Path(entry["source"]).name for entry in listed] == ["plane.ply", "other.glb"]
    table = run(*meshes, "--ground-truth", sequence).stdout
    assert all(word in table for word in ("plane", "other", "accuracy_cm", "0.962"))


def test_point_clouds_count_as_they_are(tmp_path: Path, sequence: Path) -> None:
    trimesh.PointCloud(grid(0, 0, 0.03, side=2, step=0.02)).export(tmp_path / "cloud.ply")
    found = json.loads(run(tmp_path / "cloud.ply", "--ground-truth", sequence, "--json").stdout)
    assert found["reconstruction_points"] == 10_000
    assert found["accuracy_cm"] == pytest.approx(3, abs=1e-3)


def test_units_off(tmp_path: Path, sequence: Path) -> None:
    said = failure(plane(tmp_path, scale=1000), "--ground-truth", sequence)
    assert "plane.ply" in said
    assert "1000 times" in said


def test_another_scene(tmp_path: Path, sequence: Path) -> None:
    trimesh.PointCloud(grid(50, 0, 0, side=2, step=0.1)).export(tmp_path / "cloud.ply")
    assert "align the two frames" in failure(tmp_path / "cloud.ply", "--ground-truth", sequence)


def test_missing_and_broken_files(tmp_path: Path, sequence: Path) -> None:
    assert "found no such file" in failure(tmp_path / "no.ply", "--ground-truth", sequence)
    assert "found a folder" in failure(tmp_path, "--ground-truth", sequence)
    (tmp_path / "text.ply").write_text("hello\n")
    assert "text.ply: expected a mesh" in failure(tmp_path / "text.ply", "--ground-truth", sequence)
    (tmp_path / "map.xyzzy").write_text("hello\n")
    assert "map.xyzzy: expected a mesh" in failure(tmp_path / "map.xyzzy", "--ground-truth", sequence)
    cut = plane(tmp_path, "cut.ply")
    cut.write_bytes(cut.read_bytes()[:-20])
    assert "cut.ply: expected a mesh" in failure(cut, "--ground-truth", sequence)
    (sequence / "surface.npz").unlink()
    assert "surface.npz" in failure(plane(tmp_path), "--ground-truth", sequence)
