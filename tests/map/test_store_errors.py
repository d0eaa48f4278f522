"""Wrong map files and failing disks: one line each, and what was there stays whole."""

from __future__ import annotations

import resource
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.map.scenes import blocks_of, checkpoint_of, plane, sphere, submap_of
from uppm.core.errors import MapFileError
from uppm.map.store import MapReader, MapWriter


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "map.uppm"
    blocks = blocks_of(sphere((0, 0, 0), 0.3), (-0.5,) * 3, (0.5,) * 3, 0.02, seed=0)
    with MapWriter.create(path, "", {}) as writer:
        writer.checkpoint(checkpoint_of([submap_of(1)], changed={1: blocks}))
    return path


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def overwrite_start(path: Path) -> None:
    path.write_bytes(b"PNG picture, not a map" * 100)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def sql(*statements: str) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        db = sqlite3.connect(path)
        for statement in statements:
            db.execute(statement)
        db.commit()
        db.close()

    return change


def scramble_pages(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[4096 : 8 * 16384] = bytes(8 * 16384 - 4096)
    path.write_bytes(data)


BROKEN = {
    "truncated": (truncate, "truncated or damaged"),
    "not SQLite": (overwrite_start, "another kind of file"),
    "empty": (empty, "without a map's header"),
    "scrambled": (scramble_pages, "truncated or damaged|another kind|no such table"),
    "other SQLite file": (sql("PRAGMA application_id = 0"), "without a map's header"),
    "newer schema": (sql("PRAGMA user_version = 99"), "schema 99; update uppm"),
    "table lost": (sql("PRAGMA foreign_keys = OFF", "DROP TABLE submaps"), "no such table"),
    "unknown kind": (sql("UPDATE submaps SET kind = 'ghost'"), "ghost"),
    "short pose": (sql("UPDATE submaps SET T_map_submap = x'00'"), "whole map file"),
    "no config": (sql("DELETE FROM meta WHERE key = 'config'"), "config"),
}


@pytest.mark.parametrize(("breakage", "message"), BROKEN.values(), ids=BROKEN)
def test_broken_file(path: Path, breakage: Callable[[Path], None], message: str) -> None:
    breakage(path)
    before = path.read_bytes()
    with pytest.raises(MapFileError, match=message) as error:
        MapReader.open(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)
    assert path.read_bytes() == before


@pytest.mark.parametrize("voxels", ["x'00'", "zeroblob(300)", "substr(voxels, 1, length(voxels) - 9)"])
def test_damaged_voxels(path: Path, voxels: str) -> None:
    sql(f"UPDATE blocks SET voxels = {voxels}")(path)
    reader = MapReader.open(path)
    with pytest.raises(MapFileError, match="damaged"):
        reader.blocks(1)
    reader.close()


@pytest.mark.parametrize("opening", [MapReader.open, MapWriter.resume])
def test_nothing_to_open(tmp_path: Path, opening: Callable[[Path], object]) -> None:
    with pytest.raises(MapFileError, match="nothing there"):
        opening(tmp_path / "absent.uppm")
    with pytest.raises(MapFileError, match="a folder"):
        opening(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_existing_map_is_not_replaced_unasked(path: Path) -> None:
    before = path.read_bytes()
    with pytest.raises(MapFileError, match=r"--resume .*--overwrite"):
        MapWriter.create(path, "", {})
    assert path.read_bytes() == before


def test_a_map_that_appears_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "map.uppm"
    writer = MapWriter.create(path, "", {})
    path.write_text("somebody's file")
    with pytest.raises(MapFileError, match="an existing file"):
        writer.checkpoint(checkpoint_of([submap_of(1)]))
    writer.close()
    assert path.read_text() == "somebody's file"
    assert list(tmp_path.iterdir()) == [path]


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="make it or name another"):
        MapWriter.create(tmp_path / "absent" / "map.uppm", "", {})
    with pytest.raises(MapFileError, match="a folder; add a name"):
        MapWriter.create(tmp_path, "", {}, overwrite=True)


def test_one_writer(path: Path) -> None:
    with MapWriter.resume(path):
        before = path.read_bytes()
        for second in (MapWriter.resume, lambda p: MapWriter.create(p, "", {}, overwrite=True)):
            with pytest.raises(MapFileError, match="another process writing it"):
                second(path)
        assert path.read_bytes() == before
    new = path.with_name("new.uppm")
    with MapWriter.create(new, "", {}), pytest.raises(MapFileError, match="another process writing it"):
        MapWriter.create(new, "", {})


def test_overwriting_what_is_no_map(path: Path) -> None:
    overwrite_start(path)
    with MapWriter.create(path, "", {}, overwrite=True) as writer:
        writer.checkpoint(checkpoint_of([submap_of(3)]))
    reader = MapReader.open(path)
    assert [s.id for s in reader.submaps()] == [3]
    reader.close()


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def big() -> object:
    return {2: blocks_of(plane((0.1, 0.2, 1), 0), (-1.5, -1.5, -1), (1.5, 1.5, 1), 0.02, seed=1)}


def test_disk_full_keeps_the_last_checkpoint(path: Path) -> None:
    writer = MapWriter.resume(path)
    with file_size_limit(path.stat().st_size + 65536), pytest.raises(MapFileError, match="room for the map"):
        writer.checkpoint(checkpoint_of([submap_of(1), submap_of(2)], changed=big()))
    reader = MapReader.open(path)
    assert [s.id for s in reader.submaps()] == [1]
    assert len(reader.blocks(1)) > 0
    reader.close()
    writer.checkpoint(checkpoint_of([submap_of(1), submap_of(2)], changed=big()))
    writer.close()
    reader = MapReader.open(path)
    assert len(reader.blocks(2)) > 0
    reader.close()


def test_sqlite_full_is_told_alike(path: Path) -> None:
    with MapWriter.resume(path) as writer:
        pages = writer._db.execute("PRAGMA page_count").fetchone()[0]
        writer._db.execute(f"PRAGMA max_page_count = {pages + 2}")
        with pytest.raises(MapFileError, match="room for the map"):
            writer.checkpoint(checkpoint_of([submap_of(1), submap_of(2)], changed=big()))


def test_disk_full_at_the_first_checkpoint_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "map.uppm"
    writer = MapWriter.create(path, "", {})
    with file_size_limit(131072 + 4096), pytest.raises(MapFileError, match="room for the map"):
        writer.checkpoint(checkpoint_of([submap_of(2)], changed=big()))
    writer.close()
    assert list(tmp_path.iterdir()) == []
