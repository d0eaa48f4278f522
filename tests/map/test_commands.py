"""`uppm info`, `uppm query` and `uppm export` on a map file."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest
import trimesh
import typer
from typer.testing import CliRunner

from tests.map.scenes import blocks_of, box, checkpoint_of, plane, sphere, submap_of
from uppm.cli.export import export
from uppm.cli.info import info
from uppm.cli.query import query
from uppm.core.categories import category_by_name
from uppm.core.errors import InputError, MapFileError
from uppm.core.types import Report, SubmapKind
from uppm.map.store import MapWriter

app = typer.Typer()
for command in (info, query, export):
    app.command()(command)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    categories = category_by_name()
    submaps = [
        submap_of(1, categories["cup"], bounds=((0.3, -0.45, 0.8), (0.7, -0.05, 1.2))),
        submap_of(2, categories["dining table"]),
        submap_of(3, categories["floor-wood"], kind=SubmapKind.BACKGROUND, voxel=0.05),
    ]
    changed = {
        1: blocks_of(sphere((0, 0, 0), 0.2), (-0.3,) * 3, (0.3,) * 3, 0.02),
        2: blocks_of(box((0.4, 0, 0), (0.6, 0.2, 0.3)), (0.2, -0.2, -0.2), (0.8, 0.4, 0.5), 0.02),
        3: blocks_of(plane((0, 0, 1), -0.2), (-1, -1, -0.5), (1, 1, 0.1), 0.05),
    }
    file = tmp_path_factory.mktemp("map") / "map.uppm"
    report = Report(frames=7, skipped={"blurry": 2}, dropped={"segment too small": 4})
    with MapWriter.create(file, "{}", {}) as writer:
        writer.checkpoint(checkpoint_of(submaps, changed=changed, report=report))
    return file


def run(*arguments: str | Path) -> str:
    result = CliRunner().invoke(app, [str(a) for a in arguments], env={"COLUMNS": "180"}, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_info(path: Path) -> None:
    table = run("info", path)
    for text in ("dining table", "cup 7, cup thing 2", "0.40 0.40 0.40", "7 frames, 2 objects", "blurry 2"):
        assert text in table
    found = json.loads(run("info", path, "--json"))
    assert [s["id"] for s in found["submaps"]] == [1, 2, 3]
    assert found["report"]["dropped"] == {"segment too small": 4}


def test_query(path: Path) -> None:
    found = json.loads(run("query", path, "cup", "--json", "--limit", "1"))
    assert found["found"]
    assert found["results"][0]["id"] == 1
    assert set(found["results"][0]) == {"id", "category", "matched_label", "score", "probability", "center", "extent"}
    assert "cup" in run("query", path, "cup")
    assert "nothing here matches" in run("query", path, "airplane [/x]")
    assert not json.loads(run("query", path, "airplane", "--json"))["found"]


def test_export_all(path: Path, tmp_path: Path) -> None:
    names = {"mesh": "a.glb", "objects": "objects", "json": "a.json", "top-down": "top.png", "view": "view.png"}
    options = [part for key, name in names.items() for part in (f"--{key}", tmp_path / name)]
    listed = run("export", path, "--color", "instance", *options).split()
    assert all(Path(file).is_file() for file in listed)
    assert set(trimesh.load_scene(tmp_path / "a.glb").geometry) == {"1_cup", "2_dining table", "3_floor-wood"}
    assert sorted(p.name for p in (tmp_path / "objects").iterdir()) == ["1_cup.ply", "2_dining_table.ply", "boxes.json"]
    assert json.loads((tmp_path / "a.json").read_text())["submaps"][0]["category"] == "cup"
    for name in ("top.png", "view.png"):
        image = cv2.imread(str(tmp_path / name))
        assert image is not None
        assert image.shape[1] == 1600
        assert image.std(axis=(0, 1)).min() > 3


def test_export_of_nothing_and_of_no_map(path: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--mesh"):
        run("export", path)
    with pytest.raises(MapFileError, match="nothing there"):
        run("export", tmp_path / "absent.uppm", "--mesh", tmp_path / "a.ply")
    with pytest.raises(InputError, match="a name ending in"):
        run("export", path, "--mesh", tmp_path / "a.stl")
    assert list(tmp_path.iterdir()) == []
