"""Correct a map by hand: rename, merge, delete, pin a category (docs/editing.md).

What mapping made stays in the file as it was. Corrections are a list beside it, applied when the map is opened, so that
undoing one is exact and a resumed run goes on from what mapping made, under the same corrections.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from uppm.core.categories import category_by_name, label_category
from uppm.core.errors import InputError
from uppm.core.geometry import invert
from uppm.core.types import Category, LabelRecord, Provenance, Submap, SubmapKind, SubmapState, VoxelBlocks
from uppm.fusion import descriptors
from uppm.fusion.resampling import combine, resample
from uppm.map.corrections import Action, Correction
from uppm.map.store import MapReader, MapWriter, saved_config
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.embeddings import LabelEmbeddings

MAX_NAME = 100
"""Characters of a name."""


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One thing to correct."""

    action: Action
    submap: int
    value: str = ""
    """The name to give, the category to pin, or the id of the submap to merge into `submap`."""


class CorrectedReader(MapReader):
    """A map file as it was corrected by hand."""

    def __init__(self, db: sqlite3.Connection, path: Path) -> None:
        super().__init__(db, path)
        self.corrected = Corrected(super().submaps(), self._successors)
        for correction in self.corrections():
            if not correction.undone:
                self.corrected.apply(correction)

    def submaps(self) -> tuple[Submap, ...]:
        """All submaps, by id, as corrected."""
        return self.corrected.submaps()

    def blocks(self, submap_id: int) -> VoxelBlocks:
        """Voxels of one submap, with those of what was merged into it, on its own grid."""
        kept, blocks = self.corrected.made(submap_id), super().blocks(submap_id)
        for other in self.corrected.parts(submap_id):
            part = self.corrected.made(other)
            T_other_kept = invert(part.T_map_submap) @ kept.T_map_submap
            sizes = part.voxel_size, part.truncation, kept.voxel_size, kept.truncation
            blocks = combine(blocks, resample(self.blocks(other), *sizes, T_other_kept))
        return blocks


class Corrected:
    """A map's submaps under corrections, one after the other.

    Parameters
    ----------
    submaps : as mapping made them.
    successors : submap that mapping merged away after it was corrected -> what it became part of.
    """

    def __init__(self, submaps: Iterable[Submap], successors: Mapping[int, int]) -> None:
        self._made = {submap.id: submap for submap in submaps}
        self._now, self._successors = dict(self._made), successors
        self._parts: dict[int, list[int]] = {}
        self._named: dict[int, tuple[str, Category]] = {}
        self._pinned: dict[int, Category] = {}

    def submaps(self) -> tuple[Submap, ...]:
        """By id."""
        return tuple(submap for _, submap in sorted(self._now.items()))

    def made(self, submap_id: int) -> Submap:
        """As mapping made it."""
        return self._made[submap_id]

    def parts(self, submap_id: int) -> Sequence[int]:
        """The submaps that were merged into it."""
        return self._parts.get(submap_id, ())

    def find(self, submap_id: int) -> Submap:
        """A submap that can be corrected; raises `InputError` where there is none of this id."""
        found = self._now.get(submap_id)
        if found is None or found.descriptor is None:
            what = "none such" if found is None else "one without labels, which is no object"
            expected, advice = "the id of an object or piece of background", "`uppm info` lists the ids"
            raise InputError(f"submap {submap_id}", expected=expected, found=what, advice=advice)
        return found

    def apply(self, correction: Correction) -> None:
        """One more correction; nothing where mapping dropped the submap since."""
        # What was deleted and then found to be part of something else is no reason to delete that.
        submap_id = correction.submap if correction.action == "delete" else self._follow(correction.submap)
        if submap_id not in self._now:
            return
        if correction.action == "delete":
            del self._now[submap_id]
        elif correction.action == "merge":
            self._merge(submap_id, self._follow(correction.other or 0))
        elif correction.action == "rename":
            self._named[submap_id] = (correction.name or "", category_named(correction.category or ""))
        else:
            self._pinned[submap_id] = category_named(correction.category or "")
        self._describe(submap_id)

    def _follow(self, submap_id: int) -> int:
        while submap_id not in self._now and submap_id in self._successors:
            submap_id = self._successors[submap_id]
        return submap_id

    def _merge(self, kept_id: int, other_id: int) -> None:
        if other_id in self._now and other_id != kept_id:
            self._now[kept_id] = joined(self._now[kept_id], self._now.pop(other_id))
            self._parts.setdefault(kept_id, []).append(other_id)

    def _describe(self, submap_id: int) -> None:
        """Name and category as given by hand, whatever was counted since."""
        submap = self._now.get(submap_id)
        if submap is None or submap.descriptor is None:
            return
        descriptor = submap.descriptor
        if submap_id in self._named:
            name, category = self._named[submap_id]
            record = _renamed(descriptor.labels, name, category)
            descriptor = replace(descriptor, labels=(record,), category=category, confidence=1.0)
        if submap_id in self._pinned:
            descriptor = replace(descriptor, category=self._pinned[submap_id], confidence=1.0)
        self._now[submap_id] = replace(submap, descriptor=descriptor)


def joined(kept: Submap, other: Submap) -> Submap:
    """The record of two submaps that are one; labels are counted together."""
    a, b = kept.descriptor, other.descriptor
    return replace(
        kept,
        kind=SubmapKind.OBJECT if SubmapKind.OBJECT in (kept.kind, other.kind) else kept.kind,
        state=kept.state if kept.state is other.state else SubmapState.CONFIRMED,
        descriptor=descriptors.merge(a, b) if a and b else a or b,
        first_frame=min(kept.first_frame, other.first_frame),
        last_frame=max(kept.last_frame, other.last_frame),
        views=kept.views + other.views,
        misses=min(kept.misses, other.misses),
        evidence=kept.evidence + other.evidence,
        bounds=np.stack([np.fmin(kept.bounds[0], other.bounds[0]), np.fmax(kept.bounds[1], other.bounds[1])]),
    )


def _renamed(labels: Sequence[LabelRecord], name: str, category: Category) -> LabelRecord:
    return LabelRecord(
        text=name,
        category=category.id,
        count=sum(r.count for r in labels),
        weight=sum(r.weight for r in labels),
        provenance=(Provenance.HAND,),
        first_frame=min(r.first_frame for r in labels),
        last_frame=max(r.last_frame for r in labels),
    )


def category_named(name: str) -> Category:
    """The unified category of a name, else the label's own, as in a map made with `retrieval.method: labels`."""
    return category_by_name().get(name) or label_category(name)


def edit_map(path: str | Path, edits: Sequence[Edit], author: str) -> tuple[Correction, ...]:
    """Correct a map file, all or nothing; returns the corrections, each with what was before.

    Raises
    ------
    InputError
        A submap, name or category cannot be used; nothing is changed then.
    MapFileError
        The file cannot be read or written, or is being written.
    UppmError
        A name needs the text encoder, whose weights cannot be found.
    """
    with MapWriter.resume(path) as writer:
        reader = CorrectedReader.open(path)
        editor = _Editor(reader, author)
        made = tuple(editor.correct(edit) for edit in edits)
        writer.record_corrections(made, editor.vectors)
        reader.close()
    return made


def undo_edit(path: str | Path, author: str) -> tuple[Correction, ...]:
    """Undo the latest edit that is not undone yet; returns what it was. Raises `InputError` where there is none."""
    with MapWriter.resume(path) as writer:
        reader = MapReader.open(path)
        standing = [c for c in reader.corrections() if not c.undone]
        reader.close()
        if not standing:
            advice = "`uppm edit MAP` lists what was corrected"
            raise InputError(path, expected="a correction to undo", found="none", advice=advice)
        last = standing[-1].edit
        writer.undo_corrections(last, f"{_now()} by {author}")
    return tuple(c for c in standing if c.edit == last)


class _Editor:
    """Checks edits one after the other, each on the map as the one before left it."""

    def __init__(self, reader: CorrectedReader, author: str) -> None:
        self._corrected, self._author, self._stamp = reader.corrected, author, _now()
        self._edit = max((c.edit for c in reader.corrections()), default=0) + 1
        self._embeddings = LabelEmbeddings(known=reader.label_embeddings())
        self._retriever = create_retriever(saved_config(reader.meta).retrieval, self._embeddings)
        self.vectors: dict[str, np.ndarray] = {}
        """Of the new names."""

    def correct(self, edit: Edit) -> Correction:
        """The correction that an edit is; raises `InputError` where it cannot be."""
        before: dict[str, Any] = described(self._corrected.find(edit.submap))
        name = category = other = None
        if edit.action == "rename":
            name = self._name(edit.value)
            category = self._retriever.retrieve([name])[0].name
        elif edit.action == "category":
            category = known_category(edit.value)
        elif edit.action == "merge":
            other = _other(edit)
            before["other"] = described(self._corrected.find(other))
        correction = Correction(
            edit=self._edit,
            stamp=self._stamp,
            author=self._author,
            action=edit.action,
            submap=edit.submap,
            name=name,
            category=category,
            other=other,
            before=before,
        )
        self._corrected.apply(correction)
        return correction

    def _name(self, text: str) -> str:
        name = lemmatize(text.strip())
        if not name or len(name) > MAX_NAME or not name.isprintable():
            expected = f"a name of 1 to {MAX_NAME} printable characters"
            raise InputError(
                "--rename", expected=expected, found=repr(text), advice="write ID=NAME, as 12=reading lamp"
            )
        self.vectors[name] = self._embeddings.encode([name])[0]
        return name


def known_category(name: str) -> str:
    """The name of a unified category; raises `InputError` with those that are like it."""
    if name not in category_by_name():
        near = get_close_matches(name, category_by_name(), n=3, cutoff=0.5)
        advice = f"did you mean {' or '.join(near)}?" if near else "the categories are COCO-Stuff's: chair, wall-other"
        raise InputError("--category", expected="a unified category", found=repr(name), advice=advice)
    return name


def described(submap: Submap) -> dict[str, Any]:
    """What is kept of a submap before it is corrected."""
    d = submap.descriptor
    if d is None:
        return {}
    labels = {record.text: record.count for record in d.labels}
    return {
        "label": next(iter(labels), None),
        "category": d.category.name,
        "confidence": round(d.confidence, 4),
        "labels": labels,
    }


def _other(edit: Edit) -> int:
    expected, advice = "the ids of two submaps, KEPT=OTHER", "write --merge 7=12 to make 12 part of 7"
    if not edit.value.isdecimal() or int(edit.value) == edit.submap:
        found = f"{edit.submap}={edit.value}"
        raise InputError("--merge", expected=expected, found=repr(found), advice=advice)
    return int(edit.value)


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")
