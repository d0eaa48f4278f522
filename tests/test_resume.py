"""A run that is killed, again and again, and goes on each time, ends in the map of an unbroken run."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from tests.cli.room import write_room
from uppm.core.config import Config
from uppm.core.errors import MapFileError
from uppm.map.store import MapReader
from uppm.pipeline import map_sequence, open_sequence

LIMIT_S = 300
"""A child that has not come to its next frame by then hangs."""


def start(sequence: Path, path: Path, *options: str) -> subprocess.Popen[bytes]:
    """`uppm map` in a process of its own, going on where there is a map."""
    go_on = ["--resume"] if path.exists() else options
    arguments = ["map", str(sequence), "-o", str(path), "--no-check", "--json", *go_on]
    return subprocess.Popen([sys.executable, "-m", "uppm.cli.main", *arguments], stdout=subprocess.PIPE)


def frames_done(path: Path) -> int:
    """Frames in the last checkpoint; 0 before the first."""
    with contextlib.suppress(MapFileError):
        reader = MapReader.open(path)
        with contextlib.closing(reader):
            return len(reader.frames())
    return 0


def kill(child: subprocess.Popen[bytes], path: Path, frames: int, delay_s: float) -> bool:
    """Kill the child so long after it has saved so many frames; False: it was done before."""
    while child.poll() is None and frames_done(path) < frames:
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(0.002)
    with contextlib.suppress(subprocess.TimeoutExpired):
        child.wait(delay_s)
    child.kill()
    child.communicate()
    return child.returncode == -signal.SIGKILL


def finish(child: subprocess.Popen[bytes]) -> None:
    child.communicate(timeout=LIMIT_S)
    assert child.returncode == 0


def assert_same_map(one: Path, other: Path) -> None:
    """Submaps with labels, counts and states, their voxels bit for bit, frames and counts."""
    a, b = MapReader.open(one), MapReader.open(other)
    with contextlib.closing(a), contextlib.closing(b):
        assert [s.id for s in a.submaps()] == [s.id for s in b.submaps()]
        assert a.next_id == b.next_id
        for left, right in zip(a.submaps(), b.submaps(), strict=True):
            for name in ("kind", "state", "descriptor", "voxel_size", "first_frame", "last_frame", "views", "misses"):
                assert getattr(left, name) == getattr(right, name), (left.id, name)
            assert left.evidence == pytest.approx(right.evidence, rel=1e-12)
            np.testing.assert_array_equal(left.bounds, right.bounds)
            mine, others = a.blocks(left.id), b.blocks(left.id)
            for name in ("coords", "distance", "weight", "color", "belonging"):
                np.testing.assert_array_equal(getattr(mine, name), getattr(others, name), err_msg=f"{left.id} {name}")
        assert [f.index for f in a.frames()] == [f.index for f in b.frames()]
        assert (a.report().frames, a.report().dropped) == (b.report().frames, b.report().dropped)


def unbroken(sequence: Path, path: Path, *settings: str) -> Path:
    config = Config.load(None, settings)
    map_sequence(open_sequence(sequence, config.input), path, config)
    return path


def test_killed_and_resumed_is_unbroken(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    room, path = write_room(tmp_path / "room", count=16), tmp_path / "killed.uppm"
    options = ("--perception", "groundtruth", "--checkpoint-every", "2")
    kills = 0
    for frames in (1, *sorted(rng.integers(3, 13, 2).tolist())):
        kills += kill(start(room, path, *options), path, frames, rng.uniform(0, 0.05))
    finish(start(room, path, *options))
    assert kills >= 2
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["killed.uppm"]
    settings = ("perception.profile=groundtruth", "map.checkpoint_every=2")
    assert_same_map(path, unbroken(room, tmp_path / "unbroken.uppm", *settings))


def test_resuming_what_is_done_changes_nothing(tmp_path: Path) -> None:
    room = write_room(tmp_path / "room", count=4)
    path = unbroken(room, tmp_path / "done.uppm", "perception.profile=groundtruth")
    before = path.read_bytes()
    report = map_sequence(open_sequence(room), path, resume=True)
    assert report.frames == 4
    assert path.read_bytes() == before


@pytest.mark.heavy
def test_killed_demo_is_unbroken(tmp_path: Path) -> None:
    rng = np.random.default_rng(12)
    demo, path = Path(str(resources.files("uppm.data").joinpath("demo"))), tmp_path / "killed.uppm"
    kills = 0
    for frames in (1, *sorted(rng.integers(4, 36, 4).tolist())):
        kills += kill(start(demo, path, "--checkpoint-every", "3"), path, frames, rng.uniform(0, 0.4))
    finish(start(demo, path))
    assert kills >= 4
    assert_same_map(path, unbroken(demo, tmp_path / "unbroken.uppm", "map.checkpoint_every=3"))
