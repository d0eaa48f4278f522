"""Meshes that follow a changing map equal those made anew."""

from __future__ import annotations

import dataclasses

import numpy as np

from tests.map.scenes import blocks_of, box, sphere, submap_of
from uppm.core.types import Mesh, VoxelBlocks
from uppm.map.mesh import block_keys, submap_mesh
from uppm.map.mesher import SubmapMesher


def same(a: Mesh, b: Mesh) -> None:
    for name in ("vertices", "normals", "colors", "faces"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def select(blocks: VoxelBlocks, rows: np.ndarray) -> VoxelBlocks:
    return VoxelBlocks(**{f.name: getattr(blocks, f.name)[rows] for f in dataclasses.fields(blocks)})


class Live:
    """A submap whose blocks come, change and go."""

    def __init__(self, blocks: VoxelBlocks) -> None:
        self.submap, self.mesher, self.blocks = submap_of(1, voxel=0.02), SubmapMesher(), blocks
        self.read = 0

    def at(self, coords: np.ndarray) -> VoxelBlocks:
        rows = np.searchsorted(block_keys(self.blocks.coords), block_keys(coords))
        self.read += len(coords)
        return select(self.blocks, rows)

    def step(self, blocks: VoxelBlocks, changed: np.ndarray) -> Mesh:
        self.blocks, self.read = blocks, 0
        mesh = self.mesher.update(self.submap, blocks.coords, blocks.coords[changed], self.at)
        same(mesh, submap_mesh(self.submap, blocks))
        return mesh


def test_changes_of_some_blocks_give_what_a_mesh_anew_gives() -> None:
    rng = np.random.default_rng(0)
    whole = blocks_of(box((-0.3, -0.2, -0.1), (0.5, 0.4, 0.3)), (-1,) * 3, (1,) * 3, 0.02, seed=1)
    other = blocks_of(sphere((0.1, 0.1, 0.1), 0.4), (-1,) * 3, (1,) * 3, 0.02, seed=2)
    whole = select(whole, np.isin(block_keys(whole.coords), block_keys(other.coords)))
    other = select(other, np.isin(block_keys(other.coords), block_keys(whole.coords)))
    live = Live(whole)
    live.step(whole, np.ones(len(whole), dtype=np.bool_))
    mixed = {f.name: getattr(whole, f.name).copy() for f in dataclasses.fields(whole)}
    present = np.ones(len(whole), dtype=np.bool_)
    for _ in range(6):
        changed = rng.random(len(whole)) < 0.05
        for name in ("distance", "weight", "color", "belonging"):
            mixed[name][changed] = getattr(other, name)[changed]
        came = ~present & (rng.random(len(whole)) < 0.5)
        gone = present & (rng.random(len(whole)) < 0.03)
        present = (present | came) & ~gone
        blocks = select(VoxelBlocks(**mixed), present)
        mesh = live.step(blocks, (changed | came)[present])
        assert len(mesh.faces) > 1000


def test_only_what_a_change_reaches_is_read() -> None:
    whole = blocks_of(sphere((0, 0, 0), 0.9), (-1.2,) * 3, (1.2,) * 3, 0.02)
    live = Live(whole)
    first = live.step(whole, np.ones(len(whole), dtype=np.bool_))
    assert live.step(whole, np.zeros(len(whole), dtype=np.bool_)) is first
    assert live.read == 0
    one = np.arange(len(whole)) == 5
    live.step(whole, one)
    assert 0 < live.read < len(whole) / 10


def test_a_moved_or_resampled_submap_is_followed() -> None:
    whole = blocks_of(sphere((0, 0, 0), 0.3), (-0.5,) * 3, (0.5,) * 3, 0.02)
    live, every = Live(whole), np.ones(len(whole), dtype=np.bool_)
    before = live.step(whole, every)
    pose = live.submap.T_map_submap.copy()
    pose[:3, 3] += 1
    live.submap = dataclasses.replace(live.submap, T_map_submap=pose)
    after = live.step(whole, ~every)
    np.testing.assert_allclose(after.vertices - before.vertices, 1, atol=1e-6)
    coarse = blocks_of(sphere((0, 0, 0), 0.3), (-0.5,) * 3, (0.5,) * 3, 0.05)
    live.submap = dataclasses.replace(live.submap, voxel_size=0.05, truncation=0.1)
    assert len(live.step(coarse, np.ones(len(coarse), dtype=np.bool_)).faces) < len(before.faces) / 4
