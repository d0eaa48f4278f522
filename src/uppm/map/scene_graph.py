"""A map as a scene graph: objects and background, rooms, and what stands how to what (docs/outputs.md)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, permutations
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.types import Submap, SubmapKind, SubmapState
from uppm.map.boxes import upright_box
from uppm.map.panoptic_map import PanopticMap, submap_dict
from uppm.map.relations import Body, above, against, inside, next_to, on, under
from uppm.map.scene import Scene

VERSION = 1


def scene_graph(panoptic: PanopticMap) -> dict[str, Any]:
    """What `uppm export --scene-graph` writes: JSON by `docs/scene-graph.schema.json`; lengths in metres, frame map.

    Nodes are the labeled submaps that the map believes in. Relations are those of questions (`map.relations`), of
    objects to objects, and to what they rest on or stand against; of a relation and its inverse one is written.
    """
    scene = Scene(panoptic)
    nodes = [s for s in panoptic.submaps if s.descriptor and s.state is not SubmapState.TENTATIVE]
    bodies = {s.id: scene.placed(s) for s in nodes}
    return {
        "format": "uppm-scene-graph",
        "version": VERSION,
        "units": "m",
        "up": _rounded(panoptic.up),
        "nodes": [_node(panoptic, s, bodies[s.id]) for s in nodes],
        "rooms": [
            {
                "id": room.id,
                "kind": scene.room_names.get(room.id),
                "area": round(room.area, 2),
                "center": _rounded(room.center),
                "nodes": [id_ for id_, body in bodies.items() if body and body.room == room.id],
            }
            for room in scene.rooms
        ],
        "relations": [
            {"subject": subject, "relation": relation, "object": target}
            for subject, relation, target in _relations(nodes, [b for b in bodies.values() if b])
        ],
    }


def _node(panoptic: PanopticMap, submap: Submap, body: Body | None) -> dict[str, Any]:
    box = upright_box(panoptic.submap_mesh(submap.id).vertices, panoptic.up)
    known = submap_dict(submap)
    names = ("id", "kind", "category", "confidence", "labels", "state", "first_frame", "last_frame")
    return {
        **{name: known[name] for name in names},
        "box": box.to_dict() if box else None,
        "room": body.room if body and body.room else None,
    }


def _relations(nodes: Sequence[Submap], bodies: Sequence[Body]) -> list[tuple[int, str, int]]:
    """Subject, relation and object; sorted by subject and object."""
    things = {s.id for s in nodes if s.kind is SubmapKind.OBJECT}
    objects = [body for body in bodies if body.id in things]
    background = [body for body in bodies if body.id not in things]
    found = [(a.id, name, b.id) for a, b in permutations(objects, 2) for name in _of_things(a, b)]
    found += [(a.id, "next to", b.id) for a, b in combinations(objects, 2) if next_to(a, b)]
    found += [(a.id, "against", b.id) for a in objects for b in background if against(a, b)]
    found += [(a.id, "on", b.id) for a in objects for b in background if not b.is_wall and on(a, b)]
    return sorted(found, key=lambda row: (row[0], row[2], row[1]))


def _of_things(a: Body, b: Body) -> Iterator[str]:
    """How one object is to another, without what the inverse says of the other to the one."""
    if on(a, b):
        yield "on"
    if inside(a, b):
        yield "in"
    if above(a, b):
        yield "above"
    if under(a, b) and not (on(b, a) or above(b, a) or inside(b, a)):
        yield "under"


def _rounded(values: npt.NDArray[np.float64]) -> list[float]:
    return [round(float(v), 4) for v in values]
