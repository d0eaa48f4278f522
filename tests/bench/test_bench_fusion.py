"""The fusion benchmark on a rendered room: what it counts, what it says, and what it does without Open3D."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.cli.room import NAMES, write_room
from uppm.bench.curve import growth, growth_curve
from uppm.bench.fusion import STAGES, VOLUME_STAGES, FusionCase, bench_fusion
from uppm.bench.open3d_grid import RESOLUTIONS, load_open3d
from uppm.bench.segments import grid8, segments_of
from uppm.bench.timing import Clock, Timed, figures
from uppm.cli.main import app
from uppm.core.config import FusionConfig
from uppm.core.errors import MissingExtraError
from uppm.datasets.registry import open_sequence
from uppm.fusion.volume import Volume

FRAMES = 6
SMALL = FusionConfig(max_blocks=50_000)
OPEN3D_KEYS = (
    "open3d_ms_per_frame_median",
    "open3d_ms_per_frame_median_of_least",
    "ratio_open3d",
    "open3d_blocks",
    "ratio_open3d_cpu",
)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_room(tmp_path_factory.mktemp("bench") / "room", count=FRAMES)


class FakeGrid:
    """Counts what a VoxelBlockGrid is given."""

    made: ClassVar[list[FakeGrid]] = []

    def __init__(self, **settings: Any) -> None:
        self.settings, self.integrated = settings, 0
        self.made.append(self)

    def compute_unique_block_coordinates(self, depth: Any, *camera: Any) -> range:
        return range(7)

    def integrate(self, blocks: range, depth: Any, *camera: Any) -> None:
        self.integrated += 1

    def hashmap(self) -> SimpleNamespace:
        return SimpleNamespace(size=lambda: 42)


@pytest.fixture
def fake_open3d(monkeypatch: pytest.MonkeyPatch) -> list[FakeGrid]:
    core = SimpleNamespace(float32="float32", Tensor=np.asarray, Device=str)
    geometry = SimpleNamespace(VoxelBlockGrid=FakeGrid, Image=np.asarray)
    monkeypatch.setattr(FakeGrid, "made", [])
    monkeypatch.setitem(sys.modules, "open3d", SimpleNamespace(core=core, t=SimpleNamespace(geometry=geometry)))
    return FakeGrid.made


@pytest.fixture
def no_open3d(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)


def test_a_grid_gives_each_cell_its_own_submap(room: Path) -> None:
    source = open_sequence(room)
    segmentation = grid8(source.frame(0))
    assert np.unique(segmentation.ids).tolist() == list(range(1, 9))
    assert len({d.category.id for d in segmentation.descriptors}) == 8
    case = FusionCase(voxel_size=0.05, segments="grid8", fusion=SMALL)
    found = bench_fusion(source, case, open3d=False)
    assert found["submaps"] == 8 + 1  # and freespace
    assert found["frames"] == FRAMES


def test_ground_truth_gives_each_instance_its_category(room: Path) -> None:
    segmentation = segments_of("groundtruth")(open_sequence(room).frame(0))
    assert {d.label for d in segmentation.descriptors} <= set(NAMES)
    assert {d.category.name for d in segmentation.descriptors} <= set(NAMES)


def test_the_stages_are_methods_that_the_volume_has_and_add_up(room: Path) -> None:
    assert all(callable(getattr(Volume, method)) for method in VOLUME_STAGES)
    case = FusionCase(voxel_size=None, segments="groundtruth", frames=1, fusion=SMALL)
    found = bench_fusion(open_sequence(room), case, open3d=False)
    assert tuple(found["stages"]) == STAGES
    # One frame: its stages' medians are its times.
    assert sum(found["stages"].values()) == pytest.approx(found["ms_per_frame_median"], abs=0.01)
    assert min(found["stages"][name] for name in ("view", "cull", "render", "allocate", "integrate")) > 0


def test_memory_is_that_of_the_voxels_and_their_blocks(room: Path) -> None:
    case = FusionCase(voxel_size=0.05, segments="grid8", frames=2, fusion=SMALL)
    found = bench_fusion(open_sequence(room), case, open3d=False)
    assert 11 <= found["bytes_per_voxel"] <= 12
    assert found["map_mb"] == pytest.approx(found["blocks"] * 512 * found["bytes_per_voxel"] / 1e6, abs=0.1)
    assert 0 < found["blocks_per_frame"] <= found["blocks"]
    assert found["peak_memory_mb"] > found["map_mb"]


def test_open3d_gets_each_frame_as_often(room: Path, fake_open3d: list[FakeGrid]) -> None:
    case = FusionCase(voxel_size=0.05, segments="grid8", repeat=2, fusion=SMALL)
    found = bench_fusion(open_sequence(room), case)
    # One grid of each resolution to find the faster, then one a repeat.
    assert [grid.integrated for grid in fake_open3d] == [FRAMES] * (len(RESOLUTIONS) + 2)
    assert {grid.settings["voxel_size"] for grid in fake_open3d} == {0.05}
    assert found["ratio_open3d"] > 1
    assert found["open3d_block_resolution"] in RESOLUTIONS
    assert (found["open3d_blocks"], found["open3d_blocks_per_frame"], found["note"]) == (42, 7, None)


@pytest.mark.usefixtures("no_open3d")
def test_without_open3d_ours_is_measured_and_a_line_says_what_to_install(room: Path) -> None:
    case = FusionCase(voxel_size=0.05, segments="grid8", frames=2, fusion=SMALL)
    found = bench_fusion(open_sequence(room), case)
    assert found["ms_per_frame_median"] > 0
    assert [found[key] for key in OPEN3D_KEYS] == [None] * len(OPEN3D_KEYS)
    assert found["note"] == "Open3D is not installed; run: pip install uppm[bench]"


def test_a_system_library_that_open3d_lacks_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "open3d.py").write_text("raise ImportError('libusb-1.0.so.0: cannot open shared object file')\n")
    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingExtraError, match=r"libusb-1\.0\.so\.0.*apt install"):
        load_open3d()


def test_the_map_grows_lap_by_lap(room: Path) -> None:
    case = FusionCase(voxel_size=0.05, segments="grid8", frames=3, repeat=2, fusion=SMALL)
    found = growth_curve(open_sequence(room), case, laps=3)
    assert found["frames_per_lap"] == 3
    assert len(found["lap_ms_per_frame_median"]) == 3
    first, second, third = found["lap_blocks"]
    # Laps see nothing of each other, so that each adds as much.
    assert second == pytest.approx(2 * first, rel=0.1)
    assert third == pytest.approx(3 * first, rel=0.1)
    assert (found["frames"], found["peak_memory_mb"]) == (9, max(found["lap_memory_mb"]))
    assert found["blocks_growth"] == pytest.approx(3.0, rel=0.1)


def test_growth_is_the_last_laps_time_in_the_large_map_to_that_in_the_small() -> None:
    small, large = Clock(), Clock()
    small.seconds, small.cpu_seconds = [9.0, 2.0, 4.0, 3.0], [9.0, 1.0, 1.0, 1.0]
    large.seconds, large.cpu_seconds = [9.0, 6.0, 6.0, 7.0], [9.0, 2.0, 2.0, 2.0]
    assert growth(small, large, 3) == (2.0, 2.0)


def test_figures_are_those_of_the_times() -> None:
    clocks = [Clock(), Clock()]
    clocks[0].seconds, clocks[1].seconds = [1e-3, 3e-3, 5e-3], [2e-3, 2e-3, 9e-3]
    clocks[0].cpu_seconds, clocks[1].cpu_seconds = [2e-3, 4e-3, 6e-3], [4e-3, 4e-3, 7e-3]
    assert figures(clocks) == {
        "ms_per_frame_median": 2.5,
        "ms_per_frame_mean": round(22 / 6, 3),
        "ms_per_frame_p90": 7.0,
        "ms_per_frame_median_min": 2.0,
        "ms_per_frame_median_of_least": 2.0,
        "cpu_ms_per_frame_median": 4.0,
    }


def test_a_clock_from_outside_changes_nothing_but_the_clock() -> None:
    timed = Timed([3, 1, 2], {"index": "look"})
    assert (timed.index(1), timed.count(1)) == (1, 1)
    assert list(timed.take()) == ["look"]
    assert timed.take() == {}
    with pytest.raises(ValueError, match="not in list"):
        timed.index(7)
    assert list(timed.take()) == ["look"]


@pytest.mark.usefixtures("no_open3d")
def test_the_command_prints_one_document_or_a_table(room: Path) -> None:
    wanted = ["bench", "fusion", "--sequence", str(room), "--voxel-size", "0.05", "--frames", "2"]
    wanted += ["--set", "fusion.max_blocks=50000"]
    document = json.loads(CliRunner().invoke(app, [*wanted, "--json"]).stdout)
    assert (document["voxel_size"], document["segments"], document["frames"]) == (0.05, "groundtruth", 2)
    assert document["machine"]["numba"]
    two = json.loads(CliRunner().invoke(app, [*wanted, "--voxel-size", "0.1", "--json"]).stdout)
    assert [each["voxel_size"] for each in two] == [0.05, 0.1]
    shown = CliRunner().invoke(app, wanted).stdout
    assert "integrate, ms" in shown
    assert "pip install uppm[bench]" in shown
    curve = CliRunner().invoke(app, [*wanted, "--curve", "2", "--max-memory", "100000"])
    assert curve.exit_code == 0
    assert "times the blocks, in turn with a small one" in curve.stdout
    assert "4 frames, at most" in curve.stdout
    assert CliRunner().invoke(app, [*wanted, "--curve", "2", "--max-memory", "1"]).exit_code == 1


@pytest.mark.usefixtures("no_open3d")
def test_the_table_has_a_column_a_size_and_set_of_rules(room: Path) -> None:
    wanted = ["bench", "fusion", "--sequence", str(room), "--frames", "2", "--set", "fusion.max_blocks=50000", "--json"]
    grid = json.loads(CliRunner().invoke(app, [*wanted, "--segments", "grid8"]).stdout)
    assert [each["voxel_size"] for each in grid] == [0.05, 0.03, 0.02]
    rules = json.loads(CliRunner().invoke(app, [*wanted, "--config", "uppm", "--config", "panmap"]).stdout)
    assert [(each["config"], each["voxel_size"]) for each in rules] == [("uppm", None), ("panmap", None)]
