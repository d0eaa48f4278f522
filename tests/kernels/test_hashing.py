"""The block index against a dict: insert, find, remove, in any order."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from uppm._kernels.hashing import COORD_LIMIT, EMPTY, NONE, chunk_key, find, insert, remove
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
