"""Corrections by hand: what each does, that it is undone, and that neither a resumed run nor a kill loses it."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from tests.cli.room import write_room
from tests.map.scenes import blocks_of, checkpoint_of, sphere, submap_of
from uppm.core.categories import category_by_name
from uppm.core.config import Config
from uppm.core.errors import InputError, MapFileError, UppmError
from uppm.core.types import Provenance, SubmapKind
from uppm.editing import Edit, edit_map, undo_edit
from uppm.map.panoptic_map import PanopticMap
from uppm.map.store import MapReader, MapWriter
from uppm.pipeline import map_sequence, open_map, open_sequence

CUP, CHAIR, BOWL = (category_by_name()[name] for name in ("cup", "chair", "bowl"))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Two cups, each half of a sphere's row, on grids of 2 and 3 cm; a chair; freespace."""
    submaps = [
        submap_of(1, CUP, bounds=((0, 0, 0), (1, 1, 1))),
        submap_of(2, CUP, bounds=((1, 0, 0), (2, 1, 1)), voxel=0.03),
        submap_of(3, CHAIR),
        submap_of(4, None, kind=SubmapKind.FREESPACE),
    ]
    changed = {
        1: blocks_of(sphere((0, 0, 0), 0.2), (-0.3,) * 3, (0.3,) * 3, 0.02),
        2: blocks_of(sphere((0.8, 0, 0), 0.2), (0.5, -0.3, -0.3), (1.1, 0.3, 0.3), 0.03),
    }
    file = tmp_path / "map.uppm"
    with MapWriter.create(file, Config().model_dump_json(), {}) as writer:
        writer.checkpoint(checkpoint_of(submaps, changed=changed))
    return file


def labels(panoptic: PanopticMap) -> dict[int, tuple[str, str]]:
    """Submap -> its first label and category."""
    return {s.id: (s.descriptor.labels[0].text, s.descriptor.category.name) for s in panoptic.submaps if s.descriptor}


def test_a_name_given_by_hand_is_what_the_thing_is_called_and_found_by(path: Path) -> None:
    (made,) = edit_map(path, [Edit(action="rename", submap=3, value="Armchairs")], "ann")
    assert (made.name, made.category, made.author, made.edit) == ("armchair", "chair", "ann", 1)
    assert made.before["labels"] == {"chair": 7, "chair thing": 2}
    panoptic = open_map(path)
    descriptor = panoptic.submap(3).descriptor
    assert descriptor
    (record,) = descriptor.labels
    assert (record.text, record.count, record.provenance) == ("armchair", 9, (Provenance.HAND,))
    assert descriptor.confidence == 1
    assert [a.submap.id for a in panoptic.query("armchair").results] == [3]
    assert panoptic.corrections[0] == made


def test_a_pinned_category_outlasts_a_later_name_and_a_merge(path: Path) -> None:
    edit_map(path, [Edit(action="category", submap=1, value="bowl")], "ann")
    edit_map(path, [Edit(action="rename", submap=1, value="mug"), Edit(action="merge", submap=1, value="2")], "ann")
    assert labels(open_map(path)) == {1: ("mug", "bowl"), 3: ("chair", "chair")}
    undo_edit(path, "ann")
    assert labels(open_map(path))[1] == ("cup", "bowl")


def test_merging_puts_both_surfaces_on_one_grid(path: Path) -> None:
    before = open_map(path)
    edit_map(path, [Edit(action="merge", submap=1, value="2")], "ann")
    panoptic = open_map(path)
    one = panoptic.submap(1)
    assert [s.id for s in panoptic.submaps] == [1, 3, 4]
    np.testing.assert_array_equal(one.bounds, [[0, 0, 0], [2, 1, 1]])
    assert one.views == 10
    assert one.descriptor
    assert one.descriptor.labels[0].count == 14
    mesh = panoptic.submap_mesh(1)
    apart = [before.submap_mesh(id_) for id_ in (1, 2)]
    for found, wanted in ((mesh.vertices.min(axis=0), apart[0]), (mesh.vertices.max(axis=0), apart[1])):
        corner = wanted.vertices.min(axis=0) if wanted is apart[0] else wanted.vertices.max(axis=0)
        np.testing.assert_allclose(found, corner, atol=0.03)
    # Vertices lie on either sphere.
    centers = np.array([[0, 0, 0], [0.8, 0, 0]]) + one.T_map_submap[:3, 3]
    distance = np.abs(np.linalg.norm(mesh.vertices[:, None] - centers, axis=-1) - 0.2).min(axis=1)
    assert np.quantile(distance, 0.95) < 0.01


def test_a_merged_submap_can_be_merged_again(path: Path) -> None:
    edit_map(path, [Edit(action="merge", submap=2, value="1"), Edit(action="merge", submap=3, value="2")], "ann")
    panoptic = open_map(path)
    assert [s.id for s in panoptic.submaps] == [3, 4]
    assert np.ptp(panoptic.submap_mesh(3).vertices[:, 0]) == pytest.approx(1.2, abs=0.05)


def test_what_is_deleted_is_nowhere_and_undone_it_is_back_bit_for_bit(path: Path) -> None:
    before = open_map(path)
    edit_map(path, [Edit(action="delete", submap=1)], "ann")
    panoptic = open_map(path)
    assert [s.id for s in panoptic.submaps] == [2, 3, 4]
    assert panoptic.mesh(ids=[2]).vertices.shape == before.mesh(ids=[2]).vertices.shape
    with pytest.raises(InputError, match="submap 1: expected an id of this map"):
        panoptic.submap_mesh(1)
    (undone,) = undo_edit(path, "bob")
    assert undone.action == "delete"
    after = open_map(path)
    assert labels(after) == labels(before)
    np.testing.assert_array_equal(after.blocks(1).distance, before.blocks(1).distance)
    assert after.corrections == ()
    reader = MapReader.open(path)
    assert str(reader.corrections()[0].undone).endswith("by bob")
    reader.close()


def test_edits_are_undone_one_after_the_other_and_no_further(path: Path) -> None:
    edit_map(path, [Edit(action="rename", submap=1, value="mug"), Edit(action="delete", submap=2)], "ann")
    edit_map(path, [Edit(action="rename", submap=1, value="bowl")], "ann")
    undo_edit(path, "ann")
    assert labels(open_map(path))[1][0] == "mug"
    assert len(undo_edit(path, "ann")) == 2
    assert labels(open_map(path)) == {1: ("cup", "cup"), 2: ("cup", "cup"), 3: ("chair", "chair")}
    with pytest.raises(InputError, match="expected a correction to undo, found none"):
        undo_edit(path, "ann")


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (Edit(action="delete", submap=9), "submap 9: expected the id of an object or piece of background, found none"),
        (Edit(action="delete", submap=4), "found one without labels"),
        (Edit(action="rename", submap=1, value=" "), "--rename: expected a name of 1 to 100"),
        (Edit(action="rename", submap=1, value="a\nb" + "c" * 100), "--rename: expected a name of 1 to 100"),
        (Edit(action="category", submap=1, value="cupp"), "'cupp'; did you mean cup"),
        (Edit(action="category", submap=1, value="qqqq"), "the categories are COCO-Stuff's"),
        (Edit(action="merge", submap=1, value="1"), "--merge: expected the ids of two submaps"),
        (Edit(action="merge", submap=1, value="9"), "submap 9: expected"),
    ],
)
def test_a_wrong_edit_undoes_those_beside_it(path: Path, edit: Edit, said: str) -> None:
    before = path.read_bytes()
    with pytest.raises(InputError, match=said):
        edit_map(path, [Edit(action="delete", submap=3), edit], "ann")
    assert path.read_bytes() == before


def test_a_name_without_encoder_changes_nothing(path: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def missing(*_: object) -> None:
        raise UppmError("no weights")

    monkeypatch.setattr("uppm.perception.retrieval.mpnet.model_folder", missing)
    before = path.read_bytes()
    with pytest.raises(UppmError, match="no weights"):
        edit_map(path, [Edit(action="rename", submap=1, value="quux of the house")], "ann")
    assert path.read_bytes() == before


def test_a_map_that_is_being_written_is_left_alone(path: Path) -> None:
    with MapWriter.resume(path), pytest.raises(MapFileError, match="another process writing it"):
        edit_map(path, [Edit(action="delete", submap=1)], "ann")


def test_a_failed_write_leaves_the_map(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr("uppm.map._rows.write_embeddings", full)
    with pytest.raises(MapFileError, match="no space left"):
        edit_map(path, [Edit(action="delete", submap=1)], "ann")
    assert open_map(path).corrections == ()


def test_corrections_follow_a_submap_that_mapping_merged_away_but_a_deletion_does_not(path: Path) -> None:
    edit_map(path, [Edit(action="rename", submap=2, value="mug"), Edit(action="delete", submap=3)], "ann")
    saved = MapReader.open(path)
    left = [s for s in saved.submaps() if s.id in (1, 4)]
    saved.close()
    with MapWriter.resume(path) as writer:
        writer.checkpoint(checkpoint_of(left, next_id=5, merged={2: 1, 3: 1}, frames=()))
    assert labels(open_map(path)) == {1: ("mug", "cup")}


def test_corrections_of_what_mapping_dropped_do_nothing(path: Path) -> None:
    edits = [Edit(action="rename", submap=3, value="stool"), Edit(action="merge", submap=1, value="2")]
    edit_map(path, edits, "ann")
    saved = MapReader.open(path)
    left = [s for s in saved.submaps() if s.id in (1, 4)]
    saved.close()
    with MapWriter.resume(path) as writer:
        writer.checkpoint(checkpoint_of(left, next_id=5, frames=()))
    assert labels(open_map(path)) == {1: ("cup", "cup")}


def test_a_damaged_correction_is_named(path: Path) -> None:
    edit_map(path, [Edit(action="delete", submap=1)], "ann")
    with sqlite3.connect(path) as db:
        db.execute("UPDATE corrections SET action = 'sing'")
    with pytest.raises(MapFileError, match="a correction 'sing'"):
        open_map(path)


class EndedError(Exception):
    """Stands in for a kill."""


def test_a_run_resumed_onto_an_edited_map_keeps_the_corrections(tmp_path: Path) -> None:
    """And otherwise ends in the map of a run that was never edited."""
    config = Config.load(None, ["perception.profile=groundtruth", "map.checkpoint_every=4"])
    source, path = open_sequence(write_room(tmp_path / "room")), tmp_path / "room.uppm"

    def stop(done: int, total: int) -> None:
        if done == 9:
            raise EndedError

    with pytest.raises(EndedError):
        map_sequence(source, path, config, progress=stop)
    half = tmp_path / "half.uppm"
    shutil.copy(path, half)
    ids = {category: id_ for id_, (_, category) in labels(open_map(path)).items()}
    ball, orange, wall = ids["sports ball"], ids["orange"], ids["wall-concrete"]
    edits = [
        Edit(action="rename", submap=ball, value="globe"),
        Edit(action="category", submap=orange, value="apple"),
        Edit(action="delete", submap=wall),
    ]
    edit_map(path, edits, "ann")
    map_sequence(source, path, resume=True)
    map_sequence(source, half, resume=True)
    edited, plain = open_map(path), open_map(half)
    assert len(edited.frames) == len(plain.frames) == len(source)
    assert labels(edited)[ball][0] == "globe"
    assert labels(edited)[orange] == ("orange", "apple")
    assert wall not in labels(edited)
    record, counted = edited.submap(ball), plain.submap(ball)
    assert record.views == counted.views > 8
    undo_edit(path, "ann")
    assert labels(open_map(path)) == labels(plain)
    np.testing.assert_array_equal(open_map(path).blocks(wall).weight, plain.blocks(wall).weight)
