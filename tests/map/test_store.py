"""The map file: round trips, increments, and what a killed process leaves."""

from __future__ import annotations

import dataclasses
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.map.scenes import CHAIR, CUP, WALL, blocks_of, checkpoint_of, sphere, submap_of
from uppm.core.types import FrameRecord, Report, Submap, SubmapKind, SubmapState, VoxelBlocks
from uppm.map.store import MapReader, MapWriter

NOWHERE = np.full((2, 3), np.nan)


def ball(seed: int = 0) -> VoxelBlocks:
    return blocks_of(sphere((0, 0, 0), 0.3), (-0.5,) * 3, (0.5,) * 3, 0.02, seed=seed)


def part(blocks: VoxelBlocks, chosen: np.ndarray) -> VoxelBlocks:
    return VoxelBlocks(**{f.name: getattr(blocks, f.name)[chosen] for f in dataclasses.fields(blocks)})


def assert_same_blocks(a: VoxelBlocks, b: VoxelBlocks) -> None:
    for f in dataclasses.fields(VoxelBlocks):
        np.testing.assert_array_equal(getattr(a, f.name), getattr(b, f.name), err_msg=f.name)


def assert_same_submap(a: Submap, b: Submap) -> None:
    for f in dataclasses.fields(Submap):
        np.testing.assert_equal(getattr(a, f.name), getattr(b, f.name), err_msg=f.name)


def test_round_trip(tmp_path: Path) -> None:
    path, blocks = tmp_path / "map.uppm", ball()
    free = submap_of(1, None, kind=SubmapKind.FREESPACE, bounds=NOWHERE.tolist())
    submaps = [free, submap_of(2, CUP), submap_of(5, WALL, kind=SubmapKind.BACKGROUND, state=SubmapState.TENTATIVE)]
    frames = (
        FrameRecord(index=0, stamp=1.5, T_map_camera=submaps[0].T_map_submap),
        FrameRecord(index=1, stamp=float("nan"), T_map_camera=None, skipped="unreadable"),
    )
    report = Report(frames=1, skipped={"unreadable": 1}, dropped={"too small": 3}, seconds={"fusion": 0.25})
    vector = np.linspace(0, 1, 768, dtype=np.float32)
    with MapWriter.create(path, "fusion: {}", {"sequence": "run1"}) as writer:
        writer.note("up", "0 0 1")
        changes = {"changed": {2: blocks}, "frames": frames, "report": report, "label_embeddings": {"mug": vector}}
        writer.checkpoint(checkpoint_of(submaps, next_id=9, **changes))
    reader = MapReader.open(path)
    assert (reader.meta.config, reader.meta.provenance) == ("fusion: {}", {"sequence": "run1", "up": "0 0 1"})
    for a, b in zip(submaps, reader.submaps(), strict=True):
        assert_same_submap(a, b)
    assert_same_blocks(reader.blocks(2), blocks)
    assert len(reader.blocks(5)) == 0
    for a, b in zip(frames, reader.frames(), strict=True):
        np.testing.assert_equal(dataclasses.asdict(a), dataclasses.asdict(b))
    assert reader.report() == report
    np.testing.assert_array_equal(reader.label_embeddings()["mug"], vector)
    assert reader.next_id == 9
    assert [p.name for p in tmp_path.iterdir()] == ["map.uppm"]
    reader.close()


def test_checkpoints_add_replace_prune_and_delete(tmp_path: Path) -> None:
    path, old, new = tmp_path / "map.uppm", ball(0), ball(1)
    cup, chair = submap_of(1, CUP), submap_of(2, CHAIR)
    odd = np.arange(len(old)) % 2 == 1
    with MapWriter.create(path, "", {}) as writer:
        writer.checkpoint(checkpoint_of([cup, chair], changed={1: old, 2: old}))
        voted = dataclasses.replace(cup, descriptor=chair.descriptor, views=6)
        changes = {"changed": {1: part(new, odd)}, "pruned": {1: old.coords[:4:2]}}
        second = (FrameRecord(index=1, stamp=0.6, T_map_camera=np.eye(4)),)
        writer.checkpoint(checkpoint_of([voted], next_id=3, frames=second, **changes))
    reader = MapReader.open(path)
    assert_same_submap(reader.submaps()[0], voted)
    assert len(reader.submaps()) == 1
    assert len(reader.frames()) == 2
    found = reader.blocks(1)
    assert len(found) == len(old) - 2
    kept = ~odd
    kept[:4] = False
    match = {tuple(c): i for i, c in enumerate(found.coords.tolist())}
    for source, chosen in ((new, odd), (old, kept)):
        rows = np.array([match[tuple(c)] for c in source.coords[chosen].tolist()])
        assert_same_blocks(part(found, rows), part(source, chosen))
    assert len(reader.blocks(2)) == 0
    with sqlite3.connect(path) as db:
        assert db.execute("SELECT count(*) FROM blocks WHERE submap = 2").fetchone() == (0,)
    db.close()
    reader.close()


def test_resume_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "map.uppm"
    with MapWriter.create(path, "config", {}) as writer:
        writer.checkpoint(checkpoint_of([submap_of(1)], changed={1: ball()}))
    with MapWriter.resume(path) as writer:
        second = (FrameRecord(index=1, stamp=0.6, T_map_camera=np.eye(4)),)
        writer.checkpoint(checkpoint_of([submap_of(1), submap_of(2)], changed={2: ball(1)}, frames=second))
    reader = MapReader.open(path)
    assert_same_blocks(reader.blocks(1), ball())
    assert_same_blocks(reader.blocks(2), ball(1))
    assert [f.index for f in reader.frames()] == [0, 1]
    assert reader.meta.config == "config"
    reader.close()


def test_a_map_can_be_read_while_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "map.uppm"
    with MapWriter.create(path, "", {}) as writer:
        writer.checkpoint(checkpoint_of([submap_of(1)], changed={1: ball()}))
        reader = MapReader.open(path)
        writer.checkpoint(checkpoint_of([submap_of(1), submap_of(2)], changed={1: ball(1)}))
        assert_same_blocks(reader.blocks(1), ball(1))
        reader.close()


def test_opening_reads_no_voxels(tmp_path: Path) -> None:
    path = tmp_path / "map.uppm"
    with MapWriter.create(path, "", {}) as writer:
        writer.checkpoint(checkpoint_of([submap_of(1)], changed={1: ball()}))
    read: list[str | None] = []

    def watch(action: int, table: str | None, *_: object) -> int:
        if action == sqlite3.SQLITE_READ:
            read.append(table)
        return sqlite3.SQLITE_OK

    db = sqlite3.connect(path, isolation_level=None)
    db.set_authorizer(watch)
    assert len(MapReader(db, path).submaps()) == 1
    assert "submaps" in read
    assert "blocks" not in read
    db.close()


def test_deleting_much_makes_the_file_smaller(tmp_path: Path) -> None:
    path = tmp_path / "map.uppm"
    with MapWriter.create(path, "", {}) as writer:
        writer.checkpoint(checkpoint_of([submap_of(i) for i in (1, 2, 3)], changed=dict.fromkeys((1, 2, 3), ball())))
        full = path.stat().st_size
        writer.checkpoint(checkpoint_of([submap_of(2)]))
    assert path.stat().st_size < 0.5 * full
    reader = MapReader.open(path)
    assert_same_blocks(reader.blocks(2), ball())
    reader.close()


KILLED = """
import os, signal, sys
from pathlib import Path
from tests.map.scenes import checkpoint_of, submap_of
from tests.map.test_store import ball
from uppm.core.types import Report
from uppm.map.store import MapWriter

path, steps = Path(sys.argv[1]), int(sys.argv[2])
writer = MapWriter.resume(path)
db = writer._db
# A tiny cache spills pages into the file before the commit: the kill leaves a file that is half written.
db.execute("PRAGMA cache_size = 4")
left = [steps]
def step():
    left[0] -= 1
    if left[0] < 0:
        os.kill(os.getpid(), signal.SIGKILL)
db.set_progress_handler(step, 50)
for n in range(2, 1000):
    submaps = [submap_of(i) for i in range(1, n + 1)]
    changed = {i: ball(n) for i in range(max(1, n - 2), n + 1)}
    writer.checkpoint(checkpoint_of(submaps, changed=changed, report=Report(frames=n)))
"""


@pytest.mark.parametrize("steps", np.random.default_rng(3).integers(1, 1500, 6).tolist())
def test_sigkill_leaves_the_last_checkpoint_whole(tmp_path: Path, steps: int) -> None:
    path = tmp_path / "map.uppm"
    with MapWriter.create(path, "", {}) as writer:
        writer.checkpoint(checkpoint_of([submap_of(1)], changed={1: ball(1)}, report=Report(frames=1)))
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", KILLED, str(path), str(steps)], cwd=root, check=False)
    assert done.returncode == -signal.SIGKILL
    reader = MapReader.open(path)
    n = reader.report().frames
    assert [s.id for s in reader.submaps()] == list(range(1, n + 1))
    assert reader.next_id == n + 1
    for submap in range(1, n + 1):
        assert_same_blocks(reader.blocks(submap), ball(min(n, submap + 2)))
    reader.close()
    with MapWriter.resume(path) as writer:
        writer.checkpoint(checkpoint_of([submap_of(1)], report=Report(frames=n + 1)))
    assert [p.name for p in tmp_path.iterdir()] == ["map.uppm"]


def test_sigkill_before_the_first_checkpoint_keeps_the_old_map(tmp_path: Path) -> None:
    path = tmp_path / "map.uppm"
    with MapWriter.create(path, "old", {}) as writer:
        writer.checkpoint(checkpoint_of([submap_of(1)]))
    before = path.read_bytes()
    code = (
        "import os, signal, sys\nfrom uppm.map.store import MapWriter\n"
        "MapWriter.create(sys.argv[1], 'new', {}, overwrite=True)\nos.kill(os.getpid(), signal.SIGKILL)"
    )
    assert subprocess.run([sys.executable, "-c", code, str(path)], check=False).returncode == -signal.SIGKILL
    assert path.read_bytes() == before
    with MapWriter.create(path, "newer", {}, overwrite=True) as writer:
        assert path.read_bytes() == before
        writer.checkpoint(checkpoint_of([submap_of(4)]))
    reader = MapReader.open(path)
    assert reader.meta.config == "newer"
    assert [s.id for s in reader.submaps()] == [4]
    assert [p.name for p in tmp_path.iterdir()] == ["map.uppm"]
    reader.close()


def test_overwriting_a_map_with_a_hot_journal(tmp_path: Path) -> None:
    path = tmp_path / "map.uppm"
    with MapWriter.create(path, "", {}) as writer:
        writer.checkpoint(checkpoint_of([submap_of(1)], changed={1: ball(1)}, report=Report(frames=1)))
    root = Path(__file__).resolve().parents[2]
    subprocess.run([sys.executable, "-c", KILLED, str(path), "300"], cwd=root, check=False)
    assert (tmp_path / "map.uppm-journal").exists()
    with MapWriter.create(path, "", {}, overwrite=True) as writer:
        writer.checkpoint(checkpoint_of([submap_of(7)], changed={7: ball(7)}))
    reader = MapReader.open(path)
    assert_same_blocks(reader.blocks(7), ball(7))
    reader.close()
