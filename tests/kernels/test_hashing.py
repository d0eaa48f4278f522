"""The block index against a dict: insert, find, remove, in any order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uppm._kernels.hashing import COORD_LIMIT, EMPTY, NONE, chunk_key, find, insert, remove
from uppm.core.errors import UppmError
from uppm.core.types import VoxelBlocks
from uppm.fusion.volume import Volume

operations = st.lists(st.tuples(st.sampled_from(["insert", "remove"]), st.integers(0, 40)), max_size=200)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(operations)
def test_table_behaves_as_a_dict(steps: list[tuple[str, int]]) -> None:
    keys, values = np.full(64, -1, dtype=np.int64), np.full(64, NONE, dtype=np.int32)
    truth: dict[int, int] = {}
    for n, (what, key) in enumerate(steps):
        # Multiples of the table's size: many collide.
        key *= 64
        if what == "insert" and key not in truth:
            insert(keys, values, key, n)
            truth[key] = n
        elif what == "remove":
            assert remove(keys, values, key) == (key in truth)
            truth.pop(key, None)
        assert all(find(keys, values, k) == truth.get(k, NONE) for k in range(0, 41 * 64, 64))


def test_keys_are_distinct_and_out_of_range_is_empty() -> None:
    seen = {chunk_key(s, x, y, z) for s in (0, 1, 7) for x in (-5, 0, 5) for y in (-1, 1) for z in (-COORD_LIMIT, 3)}
    assert len(seen) == 3 * 3 * 2 * 2
    assert chunk_key(0, COORD_LIMIT, 0, 0) == EMPTY
    assert chunk_key(0, 0, -COORD_LIMIT - 1, 0) == EMPTY


blocks = st.lists(st.tuples(*[st.integers(-9, 9)] * 3), min_size=1, max_size=60)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(blocks, blocks, st.integers(0, 2**32 - 1))
def test_pool_keeps_each_submaps_blocks(first: list, second: list, seed: int) -> None:
    volume = Volume(4096, 1e4, 0.2)
    slots = [volume.add(0.05, 0.1, np.eye(4), False) for _ in range(2)]
    wanted = [set(first), set(second)]
    for slot, coords in zip(slots, (first, second), strict=True):
        rows = np.array([(slot, *c) for c in coords], dtype=np.int64)
        volume._add(rows, len(rows))
    rng = np.random.default_rng(seed)
    indices = volume.indices(slots[0])
    gone = indices[rng.random(len(indices)) < 0.5]
    wanted[0] -= {tuple(c) for c in volume.pool.block_coord[gone].tolist()}
    volume.drop(slots[0], gone)
    for slot, coords in zip(slots, wanted, strict=True):
        found = [tuple(c) for c in volume.pool.block_coord[volume.indices(slot)].tolist()]
        assert found == sorted(coords)
    volume.remove(slots[1])
    assert volume.pool.used == len(wanted[0])


def filled(coords: list[tuple[int, int, int]], value: int) -> VoxelBlocks:
    """Blocks whose voxels all hold a value, sorted."""
    n = len(coords)
    return VoxelBlocks(
        coords=np.array(sorted(coords), dtype=np.int32).reshape(n, 3),
        distance=np.full((n, 8, 8, 8), value, dtype=np.int16),
        weight=np.full((n, 8, 8, 8), value, dtype=np.float32),
        color=np.full((n, 8, 8, 8, 3), value, dtype=np.uint8),
        belonging=np.full((n, 8, 8, 8, 2), value, dtype=np.uint8),
    )


some_blocks = st.lists(st.tuples(*[st.integers(-70, 70)] * 3), min_size=1, max_size=12, unique=True)
lives = st.lists(
    st.tuples(st.sampled_from(["put", "put", "drop", "remove"]), st.integers(0, 3), some_blocks, st.integers(1, 200)),
    max_size=30,
)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(lives)
def test_volume_behaves_as_a_dict_of_dicts(steps: list) -> None:
    volume, truth, slots = Volume(4096, 1e4, 0.2), {}, {}
    for what, name, coords, value in steps:
        if what == "put":
            if name not in slots:
                slots[name], truth[name] = volume.add(0.05, 0.1, np.eye(4), False), {}
            volume.put(slots[name], filled(coords, value))
            truth[name] |= dict.fromkeys(coords, value)
        elif what == "drop" and name in slots:
            at = volume.indices(slots[name])
            gone = [tuple(c) in set(coords) for c in volume.pool.block_coord[at].tolist()]
            volume.drop(slots[name], at[np.array(gone, dtype=np.bool_)])
            truth[name] = {c: v for c, v in truth[name].items() if c not in set(coords)}
        elif what == "remove" and name in slots:
            volume.remove(slots.pop(name))
            del truth[name]
    assert volume.pool.used == sum(map(len, truth.values()))
    for name, blocks in truth.items():
        found = volume.gather(volume.indices(slots[name]))
        assert [tuple(c) for c in found.coords.tolist()] == sorted(blocks)
        asked = np.array([*blocks, (71, 0, 0), (-71, 3, 9)], dtype=np.int32)
        at = volume.find(slots[name], asked)
        assert at[-2:].tolist() == [NONE, NONE]
        np.testing.assert_array_equal(volume.pool.block_coord[at[:-2]], asked[:-2])
        wanted = np.array([blocks[c] for c in sorted(blocks)], dtype=np.int64).reshape(-1, 1, 1, 1)
        for field, shape in (("distance", ()), ("weight", ()), ("color", (3,)), ("belonging", (2,))):
            values = getattr(found, field)
            assert values.shape == (len(blocks), 8, 8, 8, *shape)
            np.testing.assert_array_equal(values.T, np.broadcast_to(wanted.T, values.T.shape))


def test_more_submaps_than_there_were_slots_and_more_blocks_than_there_is_room() -> None:
    volume = Volume(4096, 1e4, 0.2)
    slots = [volume.add(0.05, 0.1, np.eye(4), False) for _ in range(200)]
    assert sorted(slots) == list(range(200))
    for n, slot in enumerate(slots):
        volume.put(slot, filled([(n, -n, 0), (0, 0, n)] if n else [(0, 0, 0)], n))
    for n, slot in enumerate(slots):
        found = volume.gather(volume.indices(slot))
        assert sorted(map(tuple, found.coords.tolist())) == sorted({(n, -n, 0), (0, 0, n)})
        assert (found.distance == n).all()
    with pytest.raises(UppmError, match=r"needs more than 4096 blocks; raise fusion.max_blocks"):
        volume.put(slots[0], filled([(x, y, 9) for x in range(70) for y in range(70)], 1))
