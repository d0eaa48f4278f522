"""The regimes through the program, on the rendered room of the reader tests."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner, Result

import uppm
from tests.cli.room import write_room
from uppm.cli.main import app
from uppm.core.errors import ConfigError, InputError
from uppm.core.geometry import backproject, transform
from uppm.core.shown import Content
from uppm.perception.fakes import fake_frame
from uppm.regimes.sequence import IdentityTracks

FRAMES = 4
QUICK = ("--points-per-m2", "1000", "--min-pixels", "50", "--set", f"input.max_frames={FRAMES}")


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_room(tmp_path_factory.mktemp("room") / "room", count=FRAMES)
    points, instance = [], []
    for n in range(FRAMES):
        frame = uppm.open_sequence(folder).frame(n)
        assert frame.truth is not None
        seen = transform(frame.T_map_camera, backproject(frame.depth, frame.intrinsics))
        points.append(seen[::2, ::2].reshape(-1, 3))
        instance.append(frame.truth.instance[::2, ::2].ravel())
    # Denser than the room's own, so that instances have enough points to be told apart in 3D.
    xyz = np.rint(1000 * np.concatenate(points)).astype(np.int16)
    np.savez(folder / "surface.npz", xyz_mm=xyz, instance=np.concatenate(instance).astype(np.uint16))
    return folder


@pytest.fixture(scope="module")
def map_file(room: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "room.uppm"
    config = uppm.Config.load(None, ["perception.profile=groundtruth"])
    uppm.map_sequence(uppm.open_sequence(room, config.input), path, config)
    return path


def no_content(seconds: float) -> Content:
    raise AssertionError("nobody watches")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)])


def results(*arguments: object) -> list[dict]:
    found = run(*arguments, "--json")
    assert found.exit_code == 0, found.output
    listed = json.loads(found.stdout)
    return listed if isinstance(listed, list) else [listed]


@pytest.fixture(scope="module")
def measured(room: Path) -> list[dict]:
    """Both front ends, mapped and measured."""
    return results("sequence", room, "--perception", "groundtruth,embedded", *QUICK)


def test_sequence(measured: list[dict]) -> None:
    truth, small = measured
    assert [truth["method"], small["method"]] == ["groundtruth", "embedded"]
    assert truth["frames"] == FRAMES
    assert truth["frames_per_second"] > 0
    assert truth["seconds"]["fusion"] > 0
    assert truth["id_switches"] == 0
    assert truth["completion_ratio_5cm"] > 0.8
    assert truth["pq_3d"] > (small["pq_3d"] or 0)
    assert truth["category_accuracy"] == 1


def test_a_second_run_gives_the_same_figures(room: Path, measured: list[dict]) -> None:
    again = results("sequence", room, "--perception", "groundtruth", *QUICK)[0]
    differing = ("frames_per_second", "seconds", "source")
    assert {k: v for k, v in again.items() if k not in differing} == {
        k: v for k, v in measured[0].items() if k not in differing
    }


def test_segmentation(room: Path) -> None:
    truth, small = results("segmentation", room, "--perception", "groundtruth,embedded")
    # What the sequence itself says of its frames is right, pixel for pixel.
    assert (truth["pq"], truth["rq"], truth["sq"], truth["miou"], truth["map_50"]) == (1, 1, 1, 1, 1)
    assert truth["frames"] == FRAMES
    assert small["pq"] < 1
    assert {"pq_things", "pq_stuff", "map_30", "map_40", "frames_per_second"} <= set(small)


def test_query(room: Path, map_file: Path, tmp_path: Path) -> None:
    prompts = tmp_path / "prompts.tsv"
    prompts.write_text("prompt\tobjects\nball\tsports ball\nsoccer ball\tsports ball\nbicycle\t\n")
    by_category = results("query", map_file, "--prompts", prompts)[0]
    assert (by_category["prompts_present"], by_category["prompts_absent"]) == (2, 1)
    assert by_category["query_top1"] == 1
    assert by_category["query_auroc_absent"] == 1
    by_instance = results("query", map_file, "--prompts", prompts, "--ground-truth", room)[0]
    assert by_instance["query_recall"] == 1
    assert [answer["prompt"] for answer in by_instance["answers"]] == ["ball", "soccer ball", "bicycle"]


def test_unknown_front_end_before_anything_runs(room: Path) -> None:
    for regime in ("sequence", "segmentation"):
        assert isinstance(run(regime, room, "--perception", "groundtruth,nonsense").exception, ConfigError)
        assert isinstance(run(regime, room, "--perception", ",").exception, InputError)


def test_frames_without_instances(room: Path, tmp_path: Path) -> None:
    bare = write_room(tmp_path / "bare", count=1)
    for file in (bare / "instance").iterdir():
        file.unlink()
    (bare / "instance").rmdir()
    failed = run("segmentation", bare, "--perception", "embedded").exception
    assert "expected frames with ground truth, found none" in str(failed)


class Images(HTMLParser):
    """What a page loads."""

    def __init__(self) -> None:
        super().__init__()
        self.sources: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]


def documented(regime: str) -> set[str]:
    """Keys that the table of docs/evaluation.md has for a regime."""
    text = Path(__file__).resolve().parents[2].joinpath("docs", "evaluation.md").read_text(encoding="utf-8")
    rows = [
        line.split("|") for line in text.split("## All keys in one table")[1].splitlines() if line.startswith("| `")
    ]
    return {row[1].strip(" `") for row in rows if regime in row[3].replace(",", " ").split()}


def test_the_table_of_keys_has_those_that_are_printed(
    room: Path, map_file: Path, measured: list[dict], tmp_path: Path
) -> None:
    assert set(measured[0]) == documented("sequence")
    assert set(results("map", map_file, "--ground-truth", room, "--points-per-m2", "400")[0]) == documented("map")
    assert set(results("segmentation", room, "--perception", "groundtruth")[0]) == documented("segmentation")
    prompts, labels = tmp_path / "prompts.tsv", tmp_path / "labels.tsv"
    prompts.write_text("prompt\tobjects\nball\tsports ball\n")
    assert set(results("query", map_file, "--prompts", prompts)[0]) == documented("query")
    labels.write_text("label\tcategories\norange\torange\n")
    assert set(results("retrieval", labels)[0]) == documented("retrieval")


def sections_and_pictures(out: Path) -> tuple[list[str], int, int]:
    """Headings, SVG plots and PNG pictures of a report, all of which lie in the file."""
    text = (out / "report.html").read_text()
    page = Images()
    page.feed(text)
    assert all(source.startswith("data:image/") for source in page.sources)
    assert json.loads((out / "report.json").read_text())["results"]
    return re.findall("<h2>(.*?)</h2>", text), text.count("image/svg"), text.count("image/png")


def test_reports_of_the_other_regimes_have_plots_and_pictures(room: Path, map_file: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs `pip install uppm[eval]`")
    frames, asked, labels = tmp_path / "frames", tmp_path / "asked", tmp_path / "labels"
    assert run("segmentation", room, "--perception", "groundtruth", "-o", frames).exit_code == 0
    headings, plots, pictures = sections_and_pictures(frames)
    assert headings == ["Figures", "Panoptic quality by class", "Where groundtruth is wrong"]
    assert (plots, pictures) == (1, len(list(frames.glob("groundtruth_frame_*.png"))))
    assert pictures > 0
    prompts = tmp_path / "prompts.tsv"
    prompts.write_text("prompt\tobjects\nball\tsports ball\nbicycle\t\n")
    assert run("query", map_file, "--prompts", prompts, "-o", asked).exit_code == 0
    assert sections_and_pictures(asked) == (["Figures", "What was found", "Probabilities", "Answers"], 1, 1)
    words = tmp_path / "labels.tsv"
    words.write_text("label\tcategories\norange\torange\nchair\tbanana\n")
    assert "chair: chair, not banana" in run("retrieval", words, "-o", labels).stdout
    assert sections_and_pictures(labels) == (["Figures", "By supercategory", "Misses"], 1, 0)


def test_report(room: Path, map_file: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs `pip install uppm[eval]`")
    mesh = uppm.open_map(map_file).mesh()
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(tmp_path / "room.ply")
    out = tmp_path / "report"
    arguments = ("map", map_file, tmp_path / "room.ply", "--ground-truth", room, "--points-per-m2", "400", "-o", out)
    shown = run(*arguments)
    assert shown.exit_code == 0, shown.output
    names = {"report.html", "report.json", "room_distance.png", "room_missed.png", "room_instances.png"}
    assert {file.name for file in out.iterdir()} == names | {"room_2_distance.png", "room_2_missed.png"}
    first = {file.name: file.read_bytes() for file in out.iterdir()}
    page = Images()
    page.feed(first["report.html"].decode())
    assert len(page.sources) == 2 + 5
    assert all(source.startswith("data:image/") for source in page.sources)
    assert re.search(r"https?://(?!www\.w3\.org)", first["report.html"].decode()) is None
    listed = json.loads(first["report.json"])
    assert [r["method"] for r in listed["results"]] == ["room", "room_2"]
    assert run(*arguments).exit_code == 0
    assert {file.name: file.read_bytes() for file in out.iterdir()} == first
    image = cv2.imread(str(out / "room_distance.png"))
    assert image is not None
    assert image.shape == (750, 1200, 3)


def test_report_folder(room: Path, map_file: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs `pip install uppm[eval]`")
    (tmp_path / "file").write_text("")
    for folder, said in ((tmp_path / "file", "found a file"), (tmp_path / "no" / "way", "found nothing there")):
        assert said in str(run("map", map_file, "--ground-truth", room, "-o", folder).exception)


def test_only_frames_with_ground_truth_tell_identities() -> None:
    tracks = IdentityTracks()
    tracks.show(fake_frame(), np.ones((48, 64), dtype=np.int32), no_content)
    assert tracks.frames == []
