"""The scene graph against its schema, and against scenes whose relations are plain."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from tests.map.scenes import blocks_of, box, checkpoint_of, plane, sphere, submap_of
from uppm.core.categories import category_by_name
from uppm.core.types import SubmapKind, SubmapState
from uppm.map.panoptic_map import PanopticMap
from uppm.map.scene_graph import scene_graph
from uppm.map.store import MapReader, MapWriter

SCHEMA = json.loads((Path(__file__).resolve().parents[2] / "docs" / "scene-graph.schema.json").read_text("utf-8"))
TABLE, CUP, LAMP, BALL, FLOOR, WALL, GHOST, REST = range(1, 9)


def validate(graph: dict[str, Any]) -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.validate(graph, SCHEMA, cls=jsonschema.Draft202012Validator)


@pytest.fixture(scope="module")
def graph(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A cup on a table at a wall, a lamp above it, a ball beside it on the floor; through a map file."""
    kinds, background = category_by_name(), {"kind": SubmapKind.BACKGROUND, "voxel": 0.05}
    parts = {
        submap_of(TABLE, kinds["dining table"]): (box((0, -0.4, -0.3), (0.8, 0.4, 0.0)), 0.02),
        submap_of(CUP, kinds["cup"]): (sphere((0.4, 0, 0.1), 0.1), 0.02),
        submap_of(LAMP, kinds["vase"]): (sphere((0.4, 0, 0.6), 0.1), 0.02),
        submap_of(BALL, kinds["sports ball"]): (sphere((1.05, 0, -0.2), 0.1), 0.02),
        submap_of(FLOOR, kinds["floor-wood"], **background): (plane((0, 0, 1), -0.3), 0.05),
        submap_of(WALL, kinds["wall-concrete"], **background): (plane((1, 0, 0), -0.05), 0.05),
        submap_of(GHOST, kinds["cup"], state=SubmapState.TENTATIVE): (sphere((0, 0, 0.5), 0.1), 0.02),
        submap_of(REST, None, **background): (plane((0, 1, 0), -1.2), 0.05),
    }
    reach = (-0.4, -1.4, -0.5), (1.5, 1.4, 0.9)
    changed = {submap.id: blocks_of(shape, *reach, voxel) for submap, (shape, voxel) in parts.items()}
    file = tmp_path_factory.mktemp("map") / "map.uppm"
    with MapWriter.create(file, "{}", {}) as writer:
        writer.checkpoint(checkpoint_of(list(parts), changed=changed))
    # As a reader of the file gets it.
    return json.loads(json.dumps(scene_graph(PanopticMap.from_file(MapReader.open(file))), allow_nan=False))


def test_it_is_what_the_schema_says(graph: dict[str, Any]) -> None:
    validate(graph)
    assert [node["id"] for node in graph["nodes"]] == [TABLE, CUP, LAMP, BALL, FLOOR, WALL]
    cup = graph["nodes"][1]
    np.testing.assert_allclose(cup["box"]["size"], [0.2, 0.2, 0.2], atol=0.01)
    np.testing.assert_allclose(cup["box"]["center"], np.add((0.4, 0, 0.1), (0.5, -0.25, 1.0)), atol=0.01)
    assert cup["labels"] == {"cup": 7, "cup thing": 2}


def test_relations_are_those_of_the_scene(graph: dict[str, Any]) -> None:
    found = {(r["subject"], r["relation"], r["object"]) for r in graph["relations"]}
    assert len(found) == len(graph["relations"])
    assert found == {
        (TABLE, "on", FLOOR),
        (TABLE, "against", WALL),
        (CUP, "on", TABLE),
        (LAMP, "above", TABLE),
        (LAMP, "above", CUP),
        (BALL, "on", FLOOR),
        (TABLE, "next to", BALL),
    }


def test_rooms_and_their_nodes_name_each_other(graph: dict[str, Any]) -> None:
    rooms = {room["id"]: room["nodes"] for room in graph["rooms"]}
    assert {node["room"] for node in graph["nodes"]} - {None} <= set(rooms)
    for id_, nodes in rooms.items():
        assert nodes == [node["id"] for node in graph["nodes"] if node["room"] == id_]


def test_a_map_of_nothing_has_a_graph() -> None:
    class Nothing:
        def blocks(self, submap_id: int):
            raise AssertionError(submap_id)

    graph = scene_graph(PanopticMap(submaps=[], voxels=Nothing()))
    validate(graph)
    assert graph["nodes"] == graph["rooms"] == graph["relations"] == []


def test_the_schema_refuses_what_is_wrong(graph: dict[str, Any]) -> None:
    for path, value in (
        (("relations", 0, "relation"), "likes"),
        (("nodes", 0, "box"), {"center": [0, 0, 0]}),
        (("nodes", 0, "confidence"), 1.5),
        (("nodes", 0, "id"), "1"),
        (("version",), 2),
        (("extra",), 1),
    ):
        wrong = copy.deepcopy(graph)
        at: Any = wrong
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = value
        with pytest.raises(jsonschema.ValidationError):
            validate(wrong)
