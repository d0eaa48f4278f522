"""The map as a user sees it, over a file."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import zstandard

from tests.map.scenes import CHAIR, CUP, WALL, blocks_of, box, checkpoint_of, plane, sphere, submap_of
from uppm.core.errors import InputError
from uppm.core.types import Report, SubmapKind, SubmapState, VoxelBlocks
from uppm.map.palette import submap_color
from uppm.map.panoptic_map import PanopticMap
from uppm.map.store import MapReader, MapWriter

BALL = blocks_of(sphere((0, 0, 0), 0.2), (-0.3,) * 3, (0.3,) * 3, 0.02)
BOX = blocks_of(box((0.4, 0, 0), (0.6, 0.2, 0.3)), (0.2, -0.2, -0.2), (0.8, 0.4, 0.5), 0.02)
FLOOR = blocks_of(plane((0, 0, 1), -0.2), (-1, -1, -0.5), (1, 1, 0.1), 0.05)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    nowhere = np.full((2, 3), np.nan).tolist()
    submaps = [
        submap_of(1, None, kind=SubmapKind.FREESPACE, bounds=nowhere, voxel=0.3),
        submap_of(2, CUP, bounds=((0.3, -0.45, 0.8), (0.7, -0.05, 1.2))),
        submap_of(3, CHAIR, state=SubmapState.INACTIVE),
        submap_of(4, CHAIR, state=SubmapState.TENTATIVE),
        submap_of(5, WALL, kind=SubmapKind.BACKGROUND, voxel=0.05),
    ]
    report = Report(frames=7, skipped={"blurry": 2}, dropped={"too small": 1}, seconds={"fusion": 0.5})
    with MapWriter.create(tmp_path / "map.uppm", "{}", {"up": "0 0 2"}) as writer:
        changed = {1: FLOOR, 2: BALL, 3: BOX, 4: BALL, 5: FLOOR}
        writer.checkpoint(checkpoint_of(submaps, changed=changed, report=report))
    return tmp_path / "map.uppm"


@pytest.fixture
def panoptic(path: Path) -> PanopticMap:
    return PanopticMap.from_file(MapReader.open(path))


def test_objects_are_believed_things(panoptic: PanopticMap) -> None:
    assert [s.id for s in panoptic.objects] == [2, 3]
    assert len(panoptic.submaps) == 5
    assert panoptic.up.tolist() == [0, 0, 1]


def test_mesh_leaves_out_freespace_and_tentative(panoptic: PanopticMap) -> None:
    parts = [panoptic.submap_mesh(i) for i in (2, 3, 5)]
    assert len(panoptic.submap_mesh(1).faces) == 0
    assert len(panoptic.mesh().faces) == sum(len(p.faces) for p in parts)
    assert len(panoptic.mesh(ids=[4]).faces) == len(parts[0].faces)


def test_colorings(panoptic: PanopticMap) -> None:
    for coloring in ("instance", "category"):
        mesh = panoptic.mesh(coloring, ids=[2, 3])
        expected = {submap_color(panoptic.submap(i), coloring) for i in (2, 3)}
        assert {tuple(c) for c in mesh.colors.tolist()} == expected
        assert len(expected) == 2
    assert len(np.unique(panoptic.mesh("color", ids=[2]).colors, axis=0)) > 50


def test_unknown_submap(panoptic: PanopticMap) -> None:
    with pytest.raises(InputError, match=r"submap 99.*uppm info"):
        panoptic.submap_mesh(99)


def test_dictionary(panoptic: PanopticMap) -> None:
    found = json.loads(json.dumps(panoptic.to_dict(), allow_nan=False))
    assert found["frames"] == 7
    assert found["report"]["skipped"] == {"blurry": 2}
    free, cup = found["submaps"][:2]
    assert (free["category"], free["center"], free["labels"]) == (None, None, {})
    assert cup == {
        "id": 2,
        "kind": "object",
        "category": "cup",
        "confidence": 0.75,
        "labels": {"cup": 7, "cup thing": 2},
        "voxel_size": 0.02,
        "center": [0.5, -0.25, 1.0],
        "extent": [0.4, 0.4, 0.4],
        "state": "confirmed",
        "first_frame": 3,
        "last_frame": 9,
    }


class Counting:
    """Voxels of one ball; counts how often they are asked for."""

    def __init__(self) -> None:
        self.asked = 0

    def blocks(self, submap_id: int) -> VoxelBlocks:
        self.asked += 1
        return BALL


def test_each_surface_is_meshed_once_and_only_when_asked() -> None:
    voxels = Counting()
    panoptic = PanopticMap(submaps=[submap_of(1)], voxels=voxels)
    panoptic.to_dict()
    assert voxels.asked == 0
    panoptic.mesh("color")
    panoptic.mesh("instance")
    assert voxels.asked == 1


def test_documented_example_reads_the_file(path: Path) -> None:
    """The layout in docs/map-file.md, followed by hand."""
    text = (Path(__file__).resolve().parents[2] / "docs" / "map-file.md").read_text()
    db = sqlite3.connect(path)
    columns = db.execute("SELECT m.name, c.name FROM sqlite_master m, pragma_table_info(m.name) c").fetchall()
    assert len(columns) > 40
    for table, column in columns:
        assert f"`{table}`" in text
        assert f"`{column}`" in text, f"{table}.{column} is not documented"
    x, y, z, voxels = db.execute("SELECT x, y, z, voxels FROM blocks WHERE submap = 2 LIMIT 1").fetchone()
    db.close()
    planes = np.frombuffer(zstandard.ZstdDecompressor().decompress(voxels), np.uint8).reshape(11, 512)
    row = int(np.flatnonzero((BALL.coords == (x, y, z)).all(axis=1))[0])
    np.testing.assert_array_equal(np.ascontiguousarray(planes[:2].T).view("<i2").ravel(), BALL.distance[row].ravel())
    np.testing.assert_array_equal(np.ascontiguousarray(planes[2:6].T).view("<f4").ravel(), BALL.weight[row].ravel())
    np.testing.assert_array_equal(planes[6:9].T, BALL.color[row].reshape(512, 3))
    np.testing.assert_array_equal(planes[9:11].T, BALL.belonging[row].reshape(512, 2))


class Basis:
    """Every text a unit vector of its own."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def encode(self, texts: Sequence[str]) -> npt.NDArray[np.float32]:
        self.texts += [text for text in texts if text not in self.texts]
        return np.eye(256, dtype=np.float32)[[self.texts.index(text) for text in texts]]


def test_query_finds_and_does_not_find(path: Path) -> None:
    made = []

    def encoder() -> Basis:
        made.append(Basis())
        return made[-1]

    vectors = {c.id: np.eye(256, dtype=np.float32)[255 - c.id] for c in (CUP, CHAIR, WALL)}
    panoptic = PanopticMap.from_file(MapReader.open(path), encoder=encoder, category_embeddings=lambda: vectors)
    assert made == []
    answer = panoptic.query("Cup ").to_dict()
    assert (answer["found"], answer["closest"]) == (True, [])
    first = answer["results"][0]
    assert (first["id"], first["category"], first["matched_label"]) == (2, "cup", "cup")
    assert first["center"] == [0.5, -0.25, 1.0]
    assert 0.5 <= first["probability"] <= 1
    nothing = panoptic.query("submarine", limit=2)
    assert not nothing.found
    assert nothing.results == ()
    assert len(nothing.closest) == 2
    assert len(made) == 1
    assert {a.submap.id for a in panoptic.query("chair").results} == {3}, "tentative submaps are not believed"


def test_query_without_words_or_encoder(path: Path) -> None:
    panoptic = PanopticMap.from_file(MapReader.open(path))
    with pytest.raises(InputError, match="a phrase"):
        panoptic.query("  ")
    with pytest.raises(InputError, match="text encoder"):
        panoptic.query("cup")
