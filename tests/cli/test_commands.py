"""What each command prints for programs and for people, on the room."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.cli.conftest import Uppm
from tests.cli.room import NAMES, write_precomputed
from tests.cli.test_wrong_input import invert_poses, truncate
from tests.map.scenes import submap_of
from uppm.cli.info import print_map
from uppm.cli.main import app
from uppm.cli.query import print_result
from uppm.core.categories import category_by_name
from uppm.core.types import Report
from uppm.map.panoptic_map import PanopticMap, QueryResult
from uppm.map.query import Answer
from uppm.perception.fakes import FakeVoxelSource

COMMANDS = (
    "map",
    "check",
    "info",
    "query",
    "export",
    "demo",
    "evaluate",
    "evaluate map",
    "evaluate retrieval",
    "bench",
)
GROUND_TRUTH = ("--perception", "groundtruth", "--json")


def test_version(uppm: Uppm) -> None:
    assert uppm("--version").out == f"uppm {version('uppm')}\n"


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help(command: str) -> None:
    result = CliRunner().invoke(app, [*command.split(), "--help"], env={"COLUMNS": "100"}, prog_name="uppm")
    assert result.exit_code == 0
    assert f"Usage: uppm {command}".rstrip() in result.stdout


def test_usage_errors_are_not_tracebacks(uppm: Uppm, whole_room: Path, tmp_path: Path) -> None:
    done = uppm("map", whole_room, "-o", tmp_path / "a.uppm", "--stride", "-2")
    assert done.code == 2
    assert "Traceback" not in done.err
    assert "stride" in done.err


def test_map_prints_one_document(uppm: Uppm, whole_room: Path, tmp_path: Path) -> None:
    path = tmp_path / "new.uppm"
    done = uppm("map", whole_room, "-o", path, *GROUND_TRUTH)
    assert (done.code, done.err) == (0, "")
    found = json.loads(done.out)
    assert set(found) == {"map", "frames", "frames_per_second", "skipped", "dropped", "seconds"}
    assert (found["map"], found["frames"], found["skipped"]) == (str(path), 12, {})
    assert {"perception", "retrieval", "fusion", "finish"} <= set(found["seconds"])
    assert found["frames_per_second"] > 0


def test_map_for_people(uppm: Uppm, whole_room: Path, tmp_path: Path) -> None:
    options = ("--perception", "groundtruth", "--stride", "2", "--max-frames", "5")
    done = uppm("map", whole_room, "-o", tmp_path / "new.uppm", *options)
    assert (done.code, done.err) == (0, "")
    assert "room: 5 frames; neighbouring ones agree within 0." in done.out
    assert "new.uppm: 5 frames, " in done.out


def test_bad_frames_are_counted(uppm: Uppm, room: Path, tmp_path: Path) -> None:
    truncate(room / "color/00003.png")
    (room / "pose/00005.txt").unlink()
    (room / "pose/00007.txt").write_text(" ".join(["nan"] * 16))
    path = tmp_path / "new.uppm"
    done = uppm("map", room, "-o", path, *GROUND_TRUTH)
    assert done.code == 0
    assert done.err.startswith("warning: 3 of 12 frames cannot be used")
    found = json.loads(done.out)
    assert found["frames"] == 9
    wanted = {"a truncated or unreadable image": 1, "a missing file": 1, "NaN or infinity in the pose": 1}
    assert found["skipped"] == wanted == json.loads(uppm("info", path, "--json").out)["report"]["skipped"]
    assert "NaN or infinity in the pose 1" in uppm("info", path).out


def test_no_frame_can_be_used(uppm: Uppm, room: Path, tmp_path: Path) -> None:
    for file in (room / "depth").iterdir():
        if file.name != "00000.png":
            truncate(file)
    (room / "pose/00000.txt").unlink()
    done = uppm("map", room, "-o", tmp_path / "new.uppm", *GROUND_TRUTH, "--no-check", "--checkpoint-every", "2")
    assert done.code == 2
    assert "error: room: expected frames that can be used, found 1 with a missing file, 11 with a trunc" in done.err
    assert not list(tmp_path.glob("*.uppm*"))


def test_inverted_poses_as_asked(uppm: Uppm, room: Path, map_file: Path, tmp_path: Path) -> None:
    invert_poses(room)
    right, wrong = tmp_path / "right.uppm", tmp_path / "wrong.uppm"
    assert uppm("map", room, "-o", right, *GROUND_TRUTH, "--invert-poses", "--max-frames", "5").code == 0
    # Without any option it is read as the map's own settings say: the same five frames, and inverted.
    assert uppm("map", room, "-o", right, "--resume", "--json").code == 0
    assert uppm("map", room, "-o", wrong, *GROUND_TRUTH, "--no-check").code == 0
    found = [json.loads(uppm("info", path, "--json").out)["submaps"] for path in (map_file, right, wrong)]
    floors = [next(s["center"] for s in submaps if s["category"] == "floor-wood") for submaps in found]
    np.testing.assert_allclose(floors[0][2], floors[1][2], atol=0.06)
    assert abs(floors[0][2] - floors[2][2]) > 0.1


def test_precomputed(uppm: Uppm, whole_room: Path, tmp_path: Path) -> None:
    path, ids = tmp_path / "new.uppm", write_precomputed(tmp_path / "ids: mine", whole_room)
    assert uppm("map", whole_room, "-o", path, "--perception", "precomputed", "--precomputed", ids).code == 0
    assert {s["category"] for s in json.loads(uppm("info", path, "--json").out)["submaps"]} - {None} == set(NAMES)


def test_info(uppm: Uppm, map_file: Path) -> None:
    done = uppm("info", map_file, "--json")
    assert (done.code, done.err) == (0, "")
    found = json.loads(done.out)
    assert found["frames"] == found["report"]["frames"] == 12
    assert {s["category"] for s in found["submaps"]} - {None} == set(NAMES)
    keys = {"id", "kind", "category", "confidence", "labels", "voxel_size", "center", "extent", "state"}
    assert all(keys | {"first_frame", "last_frame"} <= set(submap) for submap in found["submaps"])
    ball = next(s for s in found["submaps"] if s["category"] == "sports ball")
    np.testing.assert_allclose(ball["center"], [1.6, 0.3, -0.7], atol=0.35)
    assert ball["labels"] == {"sports ball": 12}


KEYS = {"id", "category", "matched_label", "score", "probability", "center", "extent"}


def test_query(uppm: Uppm, map_file: Path) -> None:
    done = uppm("query", map_file, "ball", "--json")
    assert (done.code, done.err) == (0, "")
    found = json.loads(done.out)
    assert found["found"] is True
    assert found["results"][0]["category"] == "sports ball"
    assert set(found["results"][0]) == KEYS
    nothing = json.loads(uppm("query", map_file, "airplane", "--json").out)
    assert (nothing["found"], nothing["results"]) == (False, [])
    assert "nothing here matches" in uppm("query", map_file, "airplane").out


def test_export_grids(uppm: Uppm, map_file: Path, tmp_path: Path) -> None:
    plan, cost, esdf = tmp_path / "plan.yaml", tmp_path / "cost.yaml", tmp_path / "esdf.npz"
    done = uppm(
        "export",
        map_file,
        "--occupancy",
        plan,
        "--costmap",
        cost,
        "--esdf",
        esdf,
        "--band",
        0.2,
        1,
        "--inflation",
        "chair=1",
    )
    assert done.code == 0, done.err
    names = [Path(line).name for line in done.out.split()]
    assert names == ["plan.yaml", "plan.pgm", "cost.yaml", "cost.pgm", "esdf.npz"]
    with np.load(esdf) as found:
        assert found["distance"].shape == found["state"].shape == found["category"].shape
        assert set(np.unique(found["state"])) == {-1, 0, 1}
        np.testing.assert_array_equal(found["distance"] <= 0, found["state"] == 1)
        assert found["band"].tolist() == [0.2, 1.0]
    for wrong, message in (
        (["--inflation", "chair"], "--inflation: expected NAME=METRES, found 'chair'"),
        (["--inflation", "chiar=1"], "expected a unified category, found 'chiar'"),
        (["--band", "8", "9"], "height band: expected heights over the floor, found 8 to 9 m"),
    ):
        done = uppm("export", map_file, "--costmap", tmp_path / "other.yaml", *wrong)
        assert (done.code, done.err.count("\n")) == (2, 1)
        assert message in done.err
    assert not (tmp_path / "other.yaml").exists()


def test_export(uppm: Uppm, map_file: Path, tmp_path: Path) -> None:
    targets = {"--mesh": "a.ply", "--json": "a.json", "--view": "a.png", "--objects": "objects"}
    done = uppm("export", map_file, *(part for key, name in targets.items() for part in (key, tmp_path / name)))
    assert (done.code, done.err) == (0, "")
    written = [Path(line) for line in done.out.splitlines()]
    assert {p.name for p in written} >= {"a.ply", "a.json", "a.png"}
    assert len(list((tmp_path / "objects").glob("*.ply"))) == 2
    assert all(p.stat().st_size > 100 for p in written)


def test_evaluate(uppm: Uppm, map_file: Path, whole_room: Path) -> None:
    options = ("--json", "--min-pixels", "500", "--points-per-m2", "1000")
    done = uppm("evaluate", "map", map_file, "--ground-truth", whole_room, *options)
    assert (done.code, done.err) == (0, "")
    found = json.loads(done.out)
    assert {"accuracy_cm", "completeness_cm", "chamfer_l1_cm", "completion_ratio_5cm"} <= set(found)
    # Points are 3 cm apart at that density.
    assert found["completeness_cm"] < 2.5
    assert (found["things_found"], found["one_submap_ratio"]) == (2, 1.0)


def test_evaluate_retrieval(uppm: Uppm, tmp_path: Path) -> None:
    (tmp_path / "labels.tsv").write_text("label\tcategories\norange\torange\nchair\tchair|couch\n")
    found = json.loads(uppm("evaluate", "retrieval", tmp_path / "labels.tsv", "--json").out)
    assert (found["labels"], found["accuracy"]) == (2, 1.0)


def test_check(uppm: Uppm, room: Path) -> None:
    assert json.loads(uppm("check", room, "--json").out)["ok"] is True
    invert_poses(room)
    done = uppm("check", room, "--json", "--quick")
    assert (done.code, done.err) == (1, "")
    assert json.loads(done.out)["findings"][0]["kind"] == "poses"


LONG = ("baseball glove", "building-other", "furniture-other", "structural-other")


def long_map() -> PanopticMap:
    """Objects of the longest categories, at places with the longest numbers."""
    bounds = ((-100.25, -100.25, -10.25), (-99.0, -99.0, -9.0))
    submaps = [submap_of(100 + n, category_by_name()[name], bounds=bounds) for n, name in enumerate(LONG)]
    return PanopticMap(submaps=submaps, voxels=FakeVoxelSource(), report=Report(frames=3, dropped={"too small": 2}))


@pytest.mark.parametrize("columns", [80, 160])
def test_tables_read_well(columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    panoptic = long_map()
    print_map(panoptic)
    answers = [Answer(submap=s, label=f"{s.id}", score=0.7, probability=0.9) for s in panoptic.submaps]
    print_result(QueryResult(text="a thing", results=tuple(answers), closest=()))
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert max(map(len, lines)) <= columns
    for submap in panoptic.submaps:
        place = " ".join(f"{v:.2f}" for v in submap.center)
        rows = [line for line in lines if line.startswith(f" {submap.id}")]
        assert len(rows) == 2
        assert all(place in row for row in rows)
    # Two tables of four rows, each row in two lines at most, and a dozen lines around them.
    assert len(lines) <= 2 * 2 * len(LONG) + 12
    assert ("confirmed" in "".join(lines)) == (columns == 160)
