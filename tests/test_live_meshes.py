"""`Mapper.meshes` while the map grows: what a map meshed anew would give."""

from __future__ import annotations

import numpy as np

from tests.scenes import Box, Plane, look_at, render
from uppm.core.config import Config
from uppm.core.types import GroundTruth, SubmapKind
from uppm.pipeline import Mapper

SHAPES = [Plane([0, 0, 1], 0.0), Box([-0.3, -0.2, 0.0], [0.3, 0.2, 0.4])]
NAMES = {1: "floor", 2: "suitcase"}
EYES = [[1.4 * np.cos(a), 1.4 * np.sin(a), 0.9] for a in np.linspace(0, np.pi, 6)]


def test_meshes_follow_the_map() -> None:
    config = Config.load(None, ["perception.profile=groundtruth", "fusion.max_blocks=20000"])
    mapper = Mapper(config)
    for n, eye in enumerate(EYES):
        frame, ids = render(SHAPES, look_at(eye, [0.0, 0.0, 0.2]), n)
        object.__setattr__(frame, "truth", GroundTruth(instance=ids, names=NAMES, things=frozenset({2})))
        mapper.integrate(frame)
        if n % 2:
            # Saving the map must not hide from the meshes what changed.
            mapper.checkpoint()
            check(mapper)
    kept = mapper.meshes()
    assert all(mapper.meshes()[submap_id] is mesh for submap_id, mesh in kept.items())
    mapper.finish()
    check(mapper)


def test_meshes_come_in_turn_where_time_is_short() -> None:
    """Each call is given no time, so it updates one submap: the one that waits longest."""
    mapper = Mapper(Config.load(None, ["perception.profile=groundtruth", "fusion.max_blocks=20000"]))
    for n, eye in enumerate(EYES[:2]):
        frame, ids = render(SHAPES, look_at(eye, [0.0, 0.0, 0.2]), n)
        object.__setattr__(frame, "truth", GroundTruth(instance=ids, names=NAMES, things=frozenset({2})))
        mapper.integrate(frame)
        if n == 0:
            assert [len(mapper.meshes(0.0)) for _ in range(2)] == [1, 2]
            before = dict(mapper.meshes())
    after = mapper.meshes(0.0)
    assert set(after) == set(before)
    assert sum(after[id_] is not before[id_] for id_ in before) <= 1
    for _ in before:
        mapper.meshes(0.0)
    check(mapper)


def check(mapper: Mapper) -> None:
    meshes, anew = mapper.meshes(), mapper.map
    assert set(meshes) == {s.id for s in anew.submaps if s.kind is not SubmapKind.FREESPACE}
    assert sum(len(mesh.faces) for mesh in meshes.values()) > 500
    for submap_id, mesh in meshes.items():
        expected = anew.submap_mesh(submap_id)
        for name in ("vertices", "normals", "colors", "faces"):
            np.testing.assert_array_equal(getattr(mesh, name), getattr(expected, name))
