"""What `uppm export` writes of a mapped room, read back by other programs."""

from __future__ import annotations

import json
from pathlib import Path

from tests.cli.conftest import Uppm
from tests.map.test_scene_graph import validate
from uppm.pipeline import open_map


def test_scene_graph(uppm: Uppm, map_file: Path, tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    done = uppm("export", map_file, "--scene-graph", file)
    assert (done.code, done.out) == (0, f"{file}\n")
    graph = json.loads(file.read_text(encoding="utf-8"))
    validate(graph)
    (room,) = graph["rooms"]
    assert {submap.id for submap in open_map(map_file).objects} <= set(room["nodes"])
