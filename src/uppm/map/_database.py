"""Opening SQLite map files, and one-line errors for all that goes wrong with them."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator, Mapping
from pathlib import Path
from urllib.parse import quote

from uppm.core.errors import MapFileError
from uppm.map._schema import APPLICATION_ID, PAGE_SIZE, SCHEMA_VERSION, TABLES

WAIT_S = 10.0
"""A reader waits so long for a checkpoint to end, and a checkpoint for readers."""

_FULL = "free some space; the last checkpoint is whole"
_CAUSES = (
    ("is full", "room for the map", "no space left or a file size limit", _FULL),
    ("disk i/o error", "room for the map", "a failed write or read (disk full, file size limit or quota)", _FULL),
    ("is locked", "a map that nobody else is writing", "another process writing it", "let it finish, or end it"),
    ("not a database", "a map file (SQLite)", "another kind of file", "name a file written by `uppm map`"),
    ("malformed", "a whole map file", "a truncated or damaged one", "restore it from a copy, or map again"),
    ("readonly", "a writable map file and folder", "a read-only one", "copy the map to a folder that you may write to"),
    ("unable to open", "a folder to write to", "none, or one without permission", "make the folder or name another"),
)
"""A piece of SQLite's message, and what to tell of it: expected, found, advice."""


@contextlib.contextmanager
def map_errors(path: Path) -> Iterator[None]:
    """Turn SQLite's errors and undecodable values into a `MapFileError` that names the file."""
    try:
        yield
    except sqlite3.Error as error:
        message = str(error).lower()
        for piece, expected, found, advice in _CAUSES:
            if piece in message:
                raise MapFileError(path, expected=expected, found=found, advice=advice) from error
        raise MapFileError(path, expected="a map file", found=str(error), advice="map again") from error
    except OSError as error:
        found, advice = error.strerror or str(error), "make room or name another file"
        raise MapFileError(path, expected="a file to write", found=found, advice=advice) from error
    except (ValueError, TypeError, KeyError) as error:
        if isinstance(error, MapFileError):
            raise
        advice = "restore it from a copy, or map again"
        raise MapFileError(path, expected="a whole map file", found=str(error), advice=advice) from error


@contextlib.contextmanager
def connection(path: Path, *, create: bool = False, wait_s: float = 0.0) -> Iterator[sqlite3.Connection]:
    """A connection in autocommit mode that stays open unless the block raises; without `create`, the file must exist.

    Also readers open read-write where they may: rolling back what a killed writer left half-done needs it.
    """
    uri = f"file:{quote(str(path.absolute()))}?mode={'rwc' if create else 'rw'}"
    db = sqlite3.connect(uri, uri=True, isolation_level=None, timeout=wait_s, check_same_thread=False)
    with contextlib.ExitStack() as on_error:
        on_error.callback(db.close)
        yield db
        on_error.pop_all()


def lock(db: sqlite3.Connection) -> None:
    """Become the file's one writer, at once or not at all; readers may go on reading."""
    db.execute("PRAGMA busy_timeout = 0")
    db.execute("BEGIN IMMEDIATE")
    # A commit waits for readers to finish theirs.
    db.execute(f"PRAGMA busy_timeout = {round(1000 * WAIT_S)}")


def new_map(db: sqlite3.Connection, notes: Mapping[str, str]) -> None:
    """Lay out an empty map with its notes in `meta`."""
    # Rows of 1 to 3 kB fill large pages better than SQLite's 4 kB.
    db.execute(f"PRAGMA page_size = {PAGE_SIZE}")
    db.executescript(
        f"BEGIN IMMEDIATE; PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {SCHEMA_VERSION}; {TABLES}"
    )
    db.executemany("INSERT INTO meta VALUES (?, ?)", notes.items())
    db.execute("COMMIT")


def check_exists(path: Path) -> None:
    """Raise `MapFileError` unless `path` is a file."""
    advice = "name a file written by `uppm map`"
    if path.is_dir():
        raise MapFileError(path, expected="a map file", found="a folder", advice=advice)
    if not path.exists():
        raise MapFileError(path, expected="a map file", found="nothing there", advice=advice)


def check_schema(db: sqlite3.Connection, path: Path) -> int:
    """The schema version; raises `MapFileError` for other SQLite files and for newer versions."""
    application = db.execute("PRAGMA application_id").fetchone()[0]
    version = db.execute("PRAGMA user_version").fetchone()[0]
    if application != APPLICATION_ID:
        advice = "name a file written by `uppm map`"
        raise MapFileError(path, expected="a map file", found="a file without a map's header", advice=advice)
    if version > SCHEMA_VERSION:
        expected, found = f"map schema {SCHEMA_VERSION} or older", f"schema {version}"
        raise MapFileError(path, expected=expected, found=found, advice="update uppm to read it")
    return version


def remove(path: Path) -> None:
    """Delete a database that nobody needs, with its journal."""
    path.unlink(missing_ok=True)
    path.with_name(path.name + "-journal").unlink(missing_ok=True)
