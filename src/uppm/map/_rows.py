"""The core's records as rows of the map file, and back."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.features import VisualFeature
from uppm.core.types import (
    Category,
    Change,
    ChangeState,
    DynamicDescriptor,
    FrameRecord,
    LabelRecord,
    Provenance,
    Report,
    Submap,
    SubmapKind,
    SubmapState,
)
from uppm.map._schema import CHANGES, PARTS, VISUAL_FEATURES

Row = Sequence[Any]
Parts = tuple[int, npt.NDArray[np.int32]]


def pose_blob(pose: npt.NDArray[np.float64]) -> bytes:
    """16 little-endian float64, row by row."""
    return np.ascontiguousarray(pose, dtype="<f8").tobytes()


def pose_array(blob: bytes) -> npt.NDArray[np.float64]:
    """Inverse of `pose_blob`."""
    return np.frombuffer(blob, dtype="<f8").reshape(4, 4).astype(np.float64)


def category_row(category: Category) -> Row:
    return category.id, category.name, category.supercategory, int(category.is_thing), category.voxel_size


def submap_row(s: Submap) -> Row:
    """Columns of `submaps` in order; SQLite keeps NaN bounds as NULL."""
    d = s.descriptor
    described = (d.category.id, d.confidence) if d else (None, None)
    shape = (s.voxel_size, s.truncation, pose_blob(s.T_map_submap))
    companions = ",".join(f"{other}:{frames}" for other, frames in s.companions)
    history = (s.first_frame, s.last_frame, s.views, s.misses, s.evidence, companions)
    return s.id, s.kind.value, s.state.value, *described, *shape, *history, *s.bounds.ravel().tolist()


def label_rows(submap: Submap) -> list[Row]:
    records = submap.descriptor.labels if submap.descriptor else ()
    return [
        (submap.id, i, r.text, r.category, r.count, r.weight, _joined(r.provenance), r.first_frame, r.last_frame)
        for i, r in enumerate(records)
    ]


def _joined(provenance: Iterable[Provenance]) -> str:
    return ",".join(p.value for p in provenance)


def frame_row(frame: FrameRecord) -> Row:
    """Columns of `frames` in order; SQLite keeps a NaN stamp as NULL."""
    pose = None if frame.T_map_camera is None else pose_blob(frame.T_map_camera)
    return frame.index, frame.stamp, pose, frame.skipped


def report_rows(report: Report) -> list[Row]:
    rows: list[Row] = [("frames", "", report.frames)]
    for section in ("skipped", "dropped", "seconds"):
        rows += [(section, reason, value) for reason, value in getattr(report, section).items()]
    return rows


def read_categories(rows: Iterable[Row]) -> dict[int, Category]:
    return {r[0]: Category(id=r[0], name=r[1], supercategory=r[2], is_thing=bool(r[3]), voxel_size=r[4]) for r in rows}


def read_labels(rows: Iterable[Row]) -> dict[int, list[LabelRecord]]:
    """Submap id -> labels, from rows in the order of their position."""
    labels: dict[int, list[LabelRecord]] = {}
    for submap, _, text, category, count, weight, provenance, first, last in rows:
        record = LabelRecord(
            text=text,
            category=category,
            count=count,
            weight=weight,
            provenance=tuple(Provenance(p) for p in provenance.split(",") if p),
            first_frame=first,
            last_frame=last,
        )
        labels.setdefault(submap, []).append(record)
    return labels


def read_submap(
    row: Row,
    categories: Mapping[int, Category],
    labels: Mapping[int, Sequence[LabelRecord]],
    parts: Mapping[int, Parts],
    features: Mapping[int, VisualFeature],
) -> Submap:
    """A row of `submaps` with its category, labels, parts and visual feature."""
    id_, kind, state, category, confidence, voxel_size, truncation, pose, *history = row[:14]
    first, last, views, misses, evidence, companions = history
    apart, cells = parts.get(id_, (0, None))
    descriptor = None
    if category is not None:
        descriptor = DynamicDescriptor(
            labels=tuple(labels.get(id_, ())),
            category=categories[category],
            confidence=confidence,
            feature=features.get(id_),
        )
    return Submap(
        id=id_,
        kind=SubmapKind(kind),
        state=SubmapState(state),
        descriptor=descriptor,
        voxel_size=voxel_size,
        truncation=truncation,
        T_map_submap=pose_array(pose),
        first_frame=first,
        last_frame=last,
        views=views,
        misses=misses,
        evidence=evidence,
        companions=tuple(_pair(text) for text in companions.split(",") if text),
        apart=apart,
        parts=cells,
        bounds=np.array(row[14:20], dtype=np.float64).reshape(2, 3),
    )


def _pair(text: str) -> tuple[int, int]:
    other, _, frames = text.partition(":")
    return int(other), int(frames)


def read_frame(row: Row) -> FrameRecord:
    index, stamp, pose, skipped = row
    return FrameRecord(
        index=index,
        stamp=float("nan") if stamp is None else stamp,
        T_map_camera=None if pose is None else pose_array(pose),
        skipped=skipped,
    )


def read_report(rows: Iterable[Row]) -> Report:
    sections: dict[str, dict[str, float]] = {"frames": {}, "skipped": {}, "dropped": {}, "seconds": {}}
    for section, reason, value in rows:
        sections[section][reason] = value
    counts = {name: {k: int(v) for k, v in sections[name].items()} for name in ("skipped", "dropped")}
    return Report(frames=int(sections["frames"].get("", 0)), seconds=sections["seconds"], **counts)


def change_row(position: int, change: Change) -> Row:
    """Columns of `changes` in order."""
    centers = [None if c is None else c.tolist() for c in (change.center_old, change.center_new)]
    old, new = (c or (None, None, None) for c in centers)
    described = (change.state.value, change.id_old, change.id_new, change.category, change.label)
    return position, *described, *old, *new, json.dumps(dict(change.evidence))


def read_change(row: Row) -> Change:
    state, id_old, id_new, category, label = row[1:6]
    old, new = (None if c[0] is None else np.array(c, dtype=np.float64) for c in (row[6:9], row[9:12]))
    return Change(
        state=ChangeState(state),
        id_old=id_old,
        id_new=id_new,
        category=category,
        label=label,
        center_old=old,
        center_new=new,
        evidence=json.loads(row[12]),
    )


def replace_changes(db: sqlite3.Connection, changes: Iterable[Change]) -> None:
    """Write what became of the objects of an older map, in place of an earlier comparison."""
    db.execute(CHANGES)
    db.execute("DELETE FROM changes")
    rows = [change_row(n, change) for n, change in enumerate(changes)]
    db.executemany(f"INSERT INTO changes VALUES ({', '.join('?' * 13)})", rows)


def read_changes(db: sqlite3.Connection) -> tuple[Change, ...]:
    """In the order in which they were written; none where the map was not compared with another."""
    if not has_table(db, "changes"):
        return ()
    return tuple(map(read_change, db.execute("SELECT * FROM changes ORDER BY position")))


def read_parts(db: sqlite3.Connection) -> dict[int, Parts]:
    """Submap id -> frames in which it fell apart, and the cells (N, 4) of its parts."""
    if not has_table(db, "parts"):
        return {}
    rows = db.execute("SELECT submap, frames, cells FROM parts")
    return {
        id_: (frames, np.frombuffer(cells, dtype="<i4").reshape(-1, 4).astype(np.int32)) for id_, frames, cells in rows
    }


def _write_parts(db: sqlite3.Connection, submaps: Sequence[Submap]) -> None:
    db.execute(PARTS)
    db.execute("DELETE FROM parts")
    rows = [(s.id, s.apart, s.parts.astype("<i4").tobytes()) for s in submaps if s.parts is not None]
    db.executemany("INSERT INTO parts VALUES (?, ?, ?)", rows)


def upsert_submaps(db: sqlite3.Connection, submaps: Sequence[Submap]) -> None:
    """Write all submaps with categories and labels; delete those that vanished (their blocks follow by cascade)."""
    gone = {row[0] for row in db.execute("SELECT id FROM submaps")} - {s.id for s in submaps}
    db.executemany("DELETE FROM submaps WHERE id = ?", [(id_,) for id_ in gone])
    categories = {s.descriptor.category.id: s.descriptor.category for s in submaps if s.descriptor}
    db.executemany("INSERT OR REPLACE INTO categories VALUES (?, ?, ?, ?, ?)", map(category_row, categories.values()))
    names = [row[1] for row in db.execute("PRAGMA table_info(submaps)")]
    updates = ", ".join(f"{name} = excluded.{name}" for name in names[1:])
    holes = ", ".join("?" * len(names))
    # Not INSERT OR REPLACE: replacing is deleting, and would take the blocks along.
    statement = f"INSERT INTO submaps VALUES ({holes}) ON CONFLICT (id) DO UPDATE SET {updates}"
    db.executemany(statement, map(submap_row, submaps))
    db.execute("DELETE FROM labels")
    rows = [row for submap in submaps for row in label_rows(submap)]
    db.executemany("INSERT INTO labels VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)
    _write_parts(db, submaps)
    _replace_features(db, submaps)


def _replace_features(db: sqlite3.Connection, submaps: Sequence[Submap]) -> None:
    found = [(s.id, s.descriptor.feature) for s in submaps if s.descriptor and s.descriptor.feature]
    if found:
        db.execute(VISUAL_FEATURES)
    if found or has_table(db, "visual_features"):
        rows = [(id_, f.count, f.mean.astype("<f4").tobytes()) for id_, f in found]
        db.execute("DELETE FROM visual_features")
        db.executemany("INSERT INTO visual_features VALUES (?, ?, ?)", rows)


def read_features(db: sqlite3.Connection) -> dict[int, VisualFeature]:
    """Submap id -> how it looked; none where the map was made without."""
    if not has_table(db, "visual_features"):
        return {}
    rows = db.execute("SELECT submap, count, vector FROM visual_features")
    return {r[0]: VisualFeature(mean=np.frombuffer(r[2], dtype="<f4").astype(np.float32), count=r[1]) for r in rows}


def write_embeddings(db: sqlite3.Connection, vectors: Mapping[str, npt.NDArray[np.float32]]) -> None:
    """Add label text -> unit vector (D,)."""
    rows = ((text, vector.astype("<f4").tobytes()) for text, vector in vectors.items())
    db.executemany("INSERT OR REPLACE INTO label_embeddings VALUES (?, ?)", rows)


def has_table(db: sqlite3.Connection, name: str) -> bool:
    """Whether the file has a table that not every map has."""
    return bool(db.execute("SELECT 1 FROM sqlite_master WHERE name = ?", (name,)).fetchone())
