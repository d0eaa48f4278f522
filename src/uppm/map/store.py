"""The map file: one SQLite database, one transaction a checkpoint (method.md section 5, docs/map-file.md)."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from uppm.core.config import Config
from uppm.core.errors import ConfigError, MapFileError
from uppm.core.types import Change, Checkpoint, FrameRecord, Report, Submap, VoxelBlocks
from uppm.map import _codec, _database, _rows, corrections
from uppm.map._database import map_errors

_NOTE = "provenance."
_VACUUM_SHARE = 0.25
"""On closing, the file is rewritten where deleted blocks leave more of it unused."""


@dataclass(frozen=True, kw_only=True)
class MapMeta:
    """What a map says of itself."""

    config: str = ""
    """The effective configuration, as text."""
    provenance: Mapping[str, str] = field(default_factory=dict[str, str])
    """Program versions, sequence, models and whatever else the writer noted."""


def saved_config(meta: MapMeta) -> Config:
    """The configuration that a map was made with; raises `ConfigError` where this version has other settings."""
    try:
        return Config.model_validate_json(meta.config)
    except ValidationError as error:
        found = f"{'.'.join(map(str, error.errors()[0]['loc']))}: {error.errors()[0]['msg'].lower()}"
        expected, advice = "settings of this version of uppm", "go on with the version that began it, or map again"
        raise ConfigError("the map's configuration", expected=expected, found=found, advice=advice) from None


class MapWriter:
    """Writes a map file, one transaction a checkpoint; holds SQLite's write lock, so that there is one writer.

    A new map grows beside its final name (`NAME.uppm.new`) and takes it with its first checkpoint; an older map of
    that name stays whole until then. A killed process leaves the last checkpoint.
    """

    def __init__(self, db: sqlite3.Connection, path: Path, *, staged: bool, overwrite: bool) -> None:
        self._db, self.path, self._staged, self._overwrite = db, path, staged, overwrite

    @classmethod
    def create(
        cls, path: Path | str, config: str, provenance: Mapping[str, str], *, overwrite: bool = False
    ) -> MapWriter:
        """Start a new map.

        Raises
        ------
        MapFileError
            The file exists and `overwrite` is False, its folder is missing, or another process writes it.
        """
        path = Path(path)
        check_free(path, overwrite)
        staging = _staging(path)
        with map_errors(path):
            if overwrite and path.exists():
                _settle(path)
            if staging.exists():
                _settle(staging)
                _database.remove(staging)
            notes = {"config": config, **{_NOTE + key: value for key, value in provenance.items()}}
            return cls(_begun(staging, notes), path, staged=True, overwrite=overwrite)

    @classmethod
    def resume(cls, path: Path | str) -> MapWriter:
        """Go on writing an existing map after its last checkpoint; read that with `MapReader` first."""
        path = Path(path)
        _database.check_exists(path)
        with map_errors(path), _database.connection(path) as db:
            _database.check_schema(db, path)
            _prepare(db)
        return cls(db, path, staged=False, overwrite=True)

    def checkpoint(self, checkpoint: Checkpoint) -> None:
        """Write what changed, in one transaction.

        Raises
        ------
        MapFileError
            It could not be written (disk full, say); the file then holds the checkpoint before.
        """
        with self._transaction():
            self._write(checkpoint)
        with map_errors(self.path):
            if self._staged:
                self._publish()
            else:
                _database.lock(self._db)

    def record_changes(self, changes: Iterable[Change]) -> None:
        """Write what became of the objects of an older map, with the notes since, in one transaction.

        The map must have a checkpoint. Raises `MapFileError` as `checkpoint` does.
        """
        with self._transaction():
            _rows.replace_changes(self._db, changes)
        with map_errors(self.path):
            _database.lock(self._db)

    def record_corrections(
        self, made: Iterable[corrections.Correction], vectors: Mapping[str, npt.NDArray[np.float32]]
    ) -> None:
        """Add what was corrected by hand, with the vectors of new labels, in one transaction; as `record_changes`."""
        with self._transaction():
            corrections.insert(self._db, made)
            _rows.write_embeddings(self._db, vectors)
        with map_errors(self.path):
            _database.lock(self._db)

    def undo_corrections(self, edit: int, undone: str) -> None:
        """Mark the corrections of one edit as undone, in one transaction; `undone` says by whom and when."""
        with self._transaction():
            corrections.undo(self._db, edit, undone)
        with map_errors(self.path):
            _database.lock(self._db)

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        """Commit what the block writes, or nothing of it."""
        with map_errors(self.path):
            if not self._db.in_transaction:
                _database.lock(self._db)
            try:
                yield
                self._db.execute("COMMIT")
            except sqlite3.Error:
                with contextlib.suppress(sqlite3.Error):
                    self._db.rollback()
                raise

    def note(self, key: str, value: str) -> None:
        """Add to the map's provenance, with the next checkpoint."""
        with map_errors(self.path):
            self._db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (_NOTE + key, value))

    def forget(self, prefix: str) -> None:
        """Drop the notes whose key begins so, with the next checkpoint."""
        with map_errors(self.path):
            self._db.execute("DELETE FROM meta WHERE substr(key, 1, ?) = ?", (len(_NOTE + prefix), _NOTE + prefix))

    def close(self) -> None:
        """End writing; a map without any checkpoint leaves nothing behind."""
        with map_errors(self.path):
            if self._db.in_transaction:
                self._db.rollback()
            if not self._staged:
                self._compact()
            self._db.close()
        if self._staged:
            _database.remove(_staging(self.path))

    def __enter__(self) -> MapWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write(self, checkpoint: Checkpoint) -> None:
        db = self._db
        _rows.upsert_submaps(db, checkpoint.submaps)
        for submap, coords in checkpoint.pruned.items():
            keys = [(submap, *key) for key in coords.tolist()]
            db.executemany("DELETE FROM blocks WHERE submap = ? AND x = ? AND y = ? AND z = ?", keys)
        for submap, blocks in sorted(checkpoint.changed.items()):
            keys = blocks.coords.tolist()
            rows = ((submap, *key, voxels) for key, voxels in zip(keys, _codec.encode(blocks), strict=True))
            db.executemany("INSERT OR REPLACE INTO blocks VALUES (?, ?, ?, ?, ?)", rows)
        db.executemany("INSERT OR REPLACE INTO frames VALUES (?, ?, ?, ?)", map(_rows.frame_row, checkpoint.frames))
        _rows.write_embeddings(db, checkpoint.label_embeddings)
        corrections.follow(db, checkpoint.merged)
        db.execute("DELETE FROM report")
        db.executemany("INSERT INTO report VALUES (?, ?, ?)", _rows.report_rows(checkpoint.report))
        db.execute("INSERT OR REPLACE INTO meta VALUES ('next_id', ?)", (str(checkpoint.next_id),))

    def _publish(self) -> None:
        # Closed first: SQLite would go on naming the journal after the old name.
        self._db.close()
        try:
            check_free(self.path, self._overwrite)
            _staging(self.path).replace(self.path)
            self._staged = False
        finally:
            with _database.connection(_staging(self.path) if self._staged else self.path) as self._db:
                _prepare(self._db)

    def _compact(self) -> None:
        pages = self._db.execute("PRAGMA page_count").fetchone()[0]
        unused = self._db.execute("PRAGMA freelist_count").fetchone()[0]
        if unused > _VACUUM_SHARE * pages:
            # Only a saving of space: where there is no room for the copy, the map stays as it is.
            with contextlib.suppress(sqlite3.OperationalError):
                self._db.execute("VACUUM")


Reader = TypeVar("Reader", bound="MapReader")


class MapReader:
    """A map file read at its last checkpoint. Opening reads no voxels."""

    def __init__(self, db: sqlite3.Connection, path: Path) -> None:
        self._db, self.path = db, path
        db.execute("BEGIN")
        notes = dict(db.execute("SELECT key, value FROM meta"))
        labels = _rows.read_labels(db.execute("SELECT * FROM labels ORDER BY submap, position"))
        categories = _rows.read_categories(db.execute("SELECT * FROM categories"))
        parts = _rows.read_parts(db)
        rows = db.execute("SELECT * FROM submaps ORDER BY id").fetchall()
        features = _rows.read_features(db)
        self._submaps = tuple(_rows.read_submap(row, categories, labels, parts, features) for row in rows)
        self._frames = tuple(map(_rows.read_frame, db.execute("SELECT * FROM frames ORDER BY idx")))
        self._report = _rows.read_report(db.execute("SELECT * FROM report"))
        vectors = db.execute("SELECT text, vector FROM label_embeddings")
        self._embeddings = {text: np.frombuffer(v, dtype="<f4").astype(np.float32) for text, v in vectors}
        self._changes = _rows.read_changes(db)
        self._corrections, self._successors = corrections.read(db)
        db.execute("COMMIT")
        self.next_id = int(notes.pop("next_id"))
        provenance = {key.removeprefix(_NOTE): value for key, value in notes.items() if key.startswith(_NOTE)}
        self.meta = MapMeta(config=notes["config"], provenance=provenance)

    @classmethod
    def open(cls: type[Reader], path: Path | str) -> Reader:
        """Open for reading.

        Raises
        ------
        MapFileError
            There is no such file, or it is no map, damaged, or of a newer schema.
        """
        path = Path(path)
        _database.check_exists(path)
        with map_errors(path), _database.connection(path, wait_s=_database.WAIT_S) as db:
            db.execute("PRAGMA query_only = ON")
            _database.check_schema(db, path)
            return cls(db, path)

    def submaps(self) -> tuple[Submap, ...]:
        """All submaps, by id."""
        return self._submaps

    def frames(self) -> tuple[FrameRecord, ...]:
        """Frames integrated or skipped, in order."""
        return self._frames

    def report(self) -> Report:
        """Totals at the last checkpoint."""
        return self._report

    def changes(self) -> tuple[Change, ...]:
        """What became of the objects of the older map that this one was compared with; none where it was not."""
        return self._changes

    def corrections(self) -> tuple[corrections.Correction, ...]:
        """All that was corrected by hand, undone or not, in order; `submaps` are as mapping made them."""
        return self._corrections

    def label_embeddings(self) -> Mapping[str, npt.NDArray[np.float32]]:
        """Label text -> unit vector (D,)."""
        return self._embeddings

    def blocks(self, submap_id: int) -> VoxelBlocks:
        """Voxels of one submap, read now; no blocks where there is no such submap."""
        query = "SELECT x, y, z, voxels FROM blocks WHERE submap = ? ORDER BY x, y, z"
        with map_errors(self.path):
            rows = self._db.execute(query, (submap_id,)).fetchall()
            coords = np.array([row[:3] for row in rows], dtype=np.int32).reshape(-1, 3)
            return _codec.decode(coords, [row[3] for row in rows])

    def close(self) -> None:
        """Let go of the file."""
        self._db.close()


def _staging(path: Path) -> Path:
    return path.with_name(path.name + ".new")


def _begun(staging: Path, notes: Mapping[str, str]) -> sqlite3.Connection:
    """An empty map; where there is no room even for that, nothing is left of it."""
    try:
        with _database.connection(staging, create=True) as db:
            _database.new_map(db, notes)
            _prepare(db)
            return db
    except sqlite3.OperationalError as error:
        # Locked: it is another writer's.
        if "locked" not in str(error):
            _database.remove(staging)
        raise


def check_free(path: Path, overwrite: bool) -> None:
    """Raise `MapFileError` where a map cannot be written under a name."""
    if path.is_dir():
        raise MapFileError(path, expected="a file name for the map", found="a folder", advice="add a name")
    if not path.parent.is_dir():
        raise MapFileError(path.parent, expected="a folder", found="nothing there", advice="make it or name another")
    if path.exists() and not overwrite:
        advice = "use --resume to go on with it or --overwrite to replace it"
        raise MapFileError(path, expected="a new file name", found="an existing file", advice=advice)


def _prepare(db: sqlite3.Connection) -> None:
    db.execute("PRAGMA foreign_keys = ON")
    # 64 MB: a transaction that fits is written once, at its end.
    db.execute("PRAGMA cache_size = -65536")
    _database.lock(db)


def _settle(path: Path) -> None:
    """Roll back what a killed writer left half-done, so that no journal survives the file that it belongs to.

    Raises sqlite3.OperationalError where another process is writing the file now.
    """
    try:
        with contextlib.closing(sqlite3.connect(path, isolation_level=None, timeout=0)) as db:
            db.execute("BEGIN IMMEDIATE")
            db.rollback()
    except sqlite3.OperationalError:
        raise
    except sqlite3.DatabaseError:
        # No database at all: it is replaced as asked, and a journal beside it means nothing.
        path.with_name(path.name + "-journal").unlink(missing_ok=True)
