"""The grammar of questions, and answers on an analytic scene."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from tests.map.scenes import CHAIR, CUP, blocks_of, box, checkpoint_of, label_of, submap_of
from uppm.core.categories import category_by_name
from uppm.core.types import DynamicDescriptor, Submap, VoxelBlocks
from uppm.map.panoptic_map import PanopticMap
from uppm.map.question import is_question, parse
from uppm.map.store import MapReader, MapWriter
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.labels.phrases import pos_tags

TABLE = category_by_name()["dining table"]
COLORS = {2: (200, 20, 25), 3: (20, 40, 200), 4: (130, 80, 35), 5: (200, 20, 25)}


@pytest.mark.parametrize(
    ("text", "understood"),
    [
        ("red armchair", "red armchair"),
        ("the black and white cat", "black white cat"),
        ("how many chairs are there in the kitchen", "how many: chairs in [kitchen]"),
        ("how many pictures hang on the wall?", "how many: pictures on [wall]"),
        ("largest plant", "largest plant"),
        ("the nearest cup to the sink", "nearest cup to [sink]"),
        ("which chair is closest to the window", "nearest chair to [window]"),
        ("chair farthest from the door", "farthest chair from [door]"),
        ("what is on the desk", "thing on [desk]"),
        ("what hangs above the stove", "thing above [stove]"),
        ("what is on the TV stand", "thing on [tv stand]"),
        ("lamp to the left of the bed", "lamp left of [bed]"),
        ("book between the lamp and the laptop", "book between [lamp] and [laptop]"),
        ("the lamp in the room with the bed", "lamp in the same room as [bed]"),
        ("the cup on the table next to the armchair", "cup on [table next to [armchair]]"),
        ("backpack standing under the table", "backpack under [table]"),
        ("is there a mug on the dining table", "mug on [dining table]"),
        ("where is the trash can", "trash can"),
        ("which mugs are blue", "blue mugs"),
        ("which sofa is the longest", "longest sofa"),
        ("which cats in the kitchen are black and white", "black white cats in [kitchen]"),
        ("how many doors are green", "how many: green doors"),
        ("what is the largest plant", "largest plant"),
    ],
)
def test_understood(text: str, understood: str) -> None:
    assert is_question(text)
    assert str(parse(text, pos_tags)) == understood


@pytest.mark.parametrize(
    "text", ["cup", "cup of coffee", "chest of drawers", "something to sit on", "orange", "trash can"]
)
def test_plain_phrases_are_no_questions(text: str) -> None:
    assert not is_question(text)


@pytest.mark.parametrize(
    "text", ["which room is the largest", "cup on", "book between the lamp", "what can I do with it"]
)
def test_not_covered(text: str) -> None:
    assert parse(text, pos_tags) is None


class Axes:
    """An encoder for which different words have nothing in common."""

    def __init__(self) -> None:
        self._words: dict[str, int] = {}

    def encode(self, texts: Sequence[str]) -> npt.NDArray[np.float32]:
        out = np.zeros((len(texts), 500), dtype=np.float32)
        for row, text in zip(out, texts, strict=True):
            row[self._words.setdefault(text, len(self._words))] = 1
        return out


def colored(id_: int, low: Sequence[float], high: Sequence[float]) -> VoxelBlocks:
    blocks = blocks_of(box(low, high), [v - 0.1 for v in low], [v + 0.1 for v in high], 0.02)
    blocks.color[:] = COLORS[id_]
    return blocks


@pytest.fixture
def panoptic(tmp_path: Path) -> PanopticMap:
    """A red cup (2) on a brown table (4), a blue cup (3) under it, a red chair (5) beside it."""
    boxes = {
        2: ("cup", CUP, (0.3, 0.3, 0.81), (0.4, 0.4, 0.95)),
        3: ("cup", CUP, (0.5, 0.3, 0.0), (0.6, 0.4, 0.12)),
        4: ("dining table", TABLE, (0.0, 0.0, 0.7), (1.2, 0.8, 0.8)),
        5: ("chair", CHAIR, (1.4, 0.2, 0.0), (1.8, 0.6, 0.9)),
    }
    submaps: list[Submap] = []
    changed: dict[int, VoxelBlocks] = {}
    for id_, (label, category, low, high) in boxes.items():
        changed[id_] = colored(id_, low, high)
        submap = submap_of(id_, category, bounds=(low, high))
        object.__setattr__(submap, "T_map_submap", np.eye(4))
        descriptor = DynamicDescriptor(labels=(label_of(label, 5, category),), category=category, confidence=1.0)
        object.__setattr__(submap, "descriptor", descriptor)
        submaps.append(submap)
    path = tmp_path / "map.uppm"
    with MapWriter.create(path, "{}", {}) as writer:
        writer.checkpoint(checkpoint_of(submaps, changed=changed))
    encoder = Axes()
    return PanopticMap.from_file(MapReader.open(path), encoder=lambda: encoder, lemmatize=lemmatize, tag=pos_tags)


@pytest.mark.parametrize(
    ("text", "ids"),
    [
        ("red cup", [2]),
        ("the cup on the dining table", [2]),
        ("cup under the dining table", [3]),
        ("what is on the dining table", [2]),
        ("how many cups are there", [2, 3]),
        ("the chair next to the dining table", [5]),
        ("tallest thing", [5]),
        ("the cup nearest to the chair", [3]),
        ("cup in the same room as the chair", [2, 3]),
        ("green cup", []),
        ("how many unicorns", []),
    ],
)
def test_answers(panoptic: PanopticMap, text: str, ids: list[int]) -> None:
    reply = panoptic.ask(text)
    assert reply.plain is None
    assert [found.submap.id for found in reply.results] == ids
    assert reply.count == len(ids)
    assert bool(reply.note) is not bool(ids)
    assert json.loads(json.dumps(reply.to_dict()))["found"] is bool(ids)


def test_sides_and_distances_are_from_the_viewpoint(panoptic: PanopticMap) -> None:
    assert panoptic.ask("chair right of the dining table", viewpoint=(0.6, -3, 1.5)).count == 1
    assert panoptic.ask("chair right of the dining table", viewpoint=(0.6, 4, 1.5)).count == 0
    assert [f.submap.id for f in panoptic.ask("nearest cup", viewpoint=(0.0, 0.3, 2.0)).results] == [2]


def test_plain_phrases_are_answered_as_by_the_plain_search(
    panoptic: PanopticMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(self: MapReader, submap_id: int) -> VoxelBlocks:
        raise AssertionError("a plain phrase reads no voxels")

    monkeypatch.setattr(MapReader, "blocks", read)
    reply = panoptic.ask("cup")
    assert reply.to_dict() == panoptic.query("cup").to_dict()
    assert reply.understood is None


def test_what_is_not_understood_is_searched_and_says_so(panoptic: PanopticMap) -> None:
    reply = panoptic.ask("which cup is not on the dining table")
    assert reply.plain is not None
    assert reply.to_dict()["note"] == "not understood, searched as a plain phrase"
