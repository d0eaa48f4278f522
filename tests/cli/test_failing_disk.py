"""A disk that fills up at any point of a run: one line, and the last checkpoint whole."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Uppm
from uppm.map.store import MapReader
from uppm.pipeline import open_map

LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
sys.argv = ["uppm", *sys.argv[2:]]
from uppm.cli.main import main
main()
"""
ROOM_FOR_MAP = "expected room for the map, found a failed write or read (disk full, file size limit or quota)"


def limited(size: int, *arguments: object) -> str:
    """Standard error of `uppm` where no file may grow over `size` bytes, which it must run into."""
    command = [sys.executable, "-c", LIMITED, str(size), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert done.stderr.startswith("error: ")
    return done.stderr


def mapping(room: Path, path: Path, *options: str) -> list[object]:
    settings = ("--perception", "groundtruth", "--no-check", "--json", "--checkpoint-every", "2")
    return ["map", room, "-o", path, *settings, *options]


def test_full_at_a_later_checkpoint(uppm: Uppm, whole_room: Path, map_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "new.uppm"
    error = limited(int(0.8 * map_file.stat().st_size), *mapping(whole_room, path))
    assert ROOM_FOR_MAP in error
    assert "the last checkpoint is whole" in error
    assert [p.name for p in tmp_path.iterdir()] == ["new.uppm"]
    saved = open_map(path)
    assert 0 < len(saved.frames) < 12
    assert all(len(saved.blocks(s.id)) for s in saved.submaps)
    done = uppm("map", whole_room, "-o", path, "--resume", "--json")
    assert json.loads(done.out)["frames"] == 12


@pytest.mark.parametrize("size", [20_000, 300_000], ids=["before the first checkpoint", "at the first checkpoint"])
def test_full_at_once_keeps_the_older_map(whole_room: Path, map_file: Path, tmp_path: Path, size: int) -> None:
    path = tmp_path / "old.uppm"
    path.write_bytes(map_file.read_bytes())
    assert ROOM_FOR_MAP in limited(size, *mapping(whole_room, path, "--overwrite"))
    assert [p.name for p in tmp_path.iterdir()] == ["old.uppm"]
    assert path.read_bytes() == map_file.read_bytes()


def test_full_in_an_export_keeps_the_older_file(map_file: Path, tmp_path: Path) -> None:
    mesh = tmp_path / "room.glb"
    mesh.write_bytes(b"older")
    assert "room.glb: expected room for the file, found File too large" in limited(
        10_000, "export", map_file, "--mesh", mesh
    )
    assert [p.name for p in tmp_path.iterdir()] == ["room.glb"]
    assert mesh.read_bytes() == b"older"


UNPRIVILEGED = """
import ctypes, os, sys
# The superuser's right to read and write every file (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH) is lost with the next exec.
for capability in (1, 2):
    ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)
os.execv(sys.executable, [sys.executable, "-m", "uppm.cli.main", *sys.argv[1:]])
"""


@pytest.mark.parametrize("closed", ["room/intrinsics.txt", "room.uppm", "room"])
def test_files_without_permission(room: Path, map_file: Path, tmp_path: Path, closed: str) -> None:
    path = tmp_path / "room.uppm"
    shutil.copyfile(map_file, path)
    (tmp_path / closed).chmod(0)
    arguments = ["info", str(path)] if closed == "room.uppm" else ["check", str(room)]
    command = [sys.executable, "-c", UNPRIVILEGED, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    (tmp_path / closed).chmod(0o755)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert done.stderr.startswith(f"error: {tmp_path / closed}")


def test_a_folder_that_cannot_be(uppm: Uppm, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = uppm("demo", "--output", tmp_path / "file/out")
    assert done.code == 2
    assert done.err.endswith("out: expected a folder to write to, found Not a directory; name another with --output\n")


def test_a_reader_does_not_change_a_map(uppm: Uppm, map_file: Path) -> None:
    before = map_file.read_bytes()
    for arguments in (["info", map_file], ["query", map_file, "ball"], ["evaluate", "map", map_file, "--help"]):
        assert uppm(*arguments).code == 0
    MapReader.open(map_file).close()
    assert map_file.read_bytes() == before
