"""What was corrected by hand, as the map file keeps it: a list beside what mapping made (docs/editing.md)."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from uppm.map import _rows
from uppm.map._schema import CORRECTIONS, SUCCESSORS

Action = Literal["merge", "rename", "category", "delete"]
ACTIONS: tuple[Action, ...] = ("merge", "rename", "category", "delete")


@dataclass(frozen=True, kw_only=True)
class Correction:
    """One thing corrected."""

    edit: int
    """Corrections of one command have one number, from 1, and are undone together."""
    stamp: str
    """When, UTC, ISO 8601."""
    author: str
    """Who."""
    action: Action
    submap: int
    """Which submap."""
    name: str | None = None
    """Of `rename`: what it is called, lemmatised."""
    category: str | None = None
    """Of `rename` and `category`: name of the unified category that it has from now on."""
    other: int | None = None
    """Of `merge`: the submap that becomes part of it."""
    before: Mapping[str, Any] = field(default_factory=dict[str, Any], compare=False)
    """What the submap was: `label`, `category`, `confidence`, `labels` with their counts; of `merge` also `other`."""
    undone: str | None = None
    """When and by whom it was undone."""


def insert(db: sqlite3.Connection, made: Iterable[Correction]) -> None:
    """Add corrections after those that the file has."""
    db.execute(CORRECTIONS)
    rows = [
        (
            c.edit,
            c.stamp,
            c.author,
            c.action,
            c.submap,
            c.name,
            c.category,
            c.other,
            json.dumps(dict(c.before)),
            c.undone,
        )
        for c in made
    ]
    db.executemany(f"INSERT INTO corrections VALUES (NULL, {', '.join('?' * 10)})", rows)


def undo(db: sqlite3.Connection, edit: int, undone: str) -> None:
    """Mark the corrections of one edit as undone; they stay in the file."""
    db.execute("UPDATE corrections SET undone = ? WHERE edit = ?", (undone, edit))


def follow(db: sqlite3.Connection, merged: Mapping[int, int]) -> None:
    """Note which submaps mapping merged away, so that what was corrected of one holds for the one that it became."""
    if merged and _rows.has_table(db, "corrections"):
        db.execute(SUCCESSORS)
        db.executemany("INSERT OR REPLACE INTO successors VALUES (?, ?)", merged.items())


def read(db: sqlite3.Connection) -> tuple[tuple[Correction, ...], dict[int, int]]:
    """All corrections in order, and submap merged away by mapping since -> what it became part of."""
    if not _rows.has_table(db, "corrections"):
        return (), {}
    rows = db.execute("SELECT * FROM corrections ORDER BY number")
    successors = dict(db.execute("SELECT * FROM successors")) if _rows.has_table(db, "successors") else {}
    return tuple(map(_read_row, rows)), successors


def _read_row(row: _rows.Row) -> Correction:
    _, edit, stamp, author, action, submap, name, category, other, before, undone = row
    if action not in ACTIONS:
        raise ValueError(f"a correction {action!r}")
    return Correction(
        edit=edit,
        stamp=stamp,
        author=author,
        action=action,
        submap=submap,
        name=name,
        category=category,
        other=other,
        before=json.loads(before),
        undone=undone,
    )
