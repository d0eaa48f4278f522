"""The block index: a hash table of chunks (4x4x4 blocks of one submap), each a dense table of its 64 blocks.

One table serves all submaps: the key holds the submap's slot and the chunk's coordinates. Open addressing, linear
probing, deletion by backward shift, so that probe sequences never hold tombstones.
"""

from __future__ import annotations

import numba as nb
import numpy as np

CHUNK = 4
"""Blocks along each side of a chunk."""
CHUNK_BITS = 2
BLOCKS_PER_CHUNK = CHUNK**3
COORD_LIMIT = 1 << 14
"""Chunk coordinates lie in [-COORD_LIMIT, COORD_LIMIT)."""
SLOT_LIMIT = 1 << 18
EMPTY = np.int64(-1)
NONE = -1


@nb.njit(inline="always")
def chunk_key(slot, cx, cy, cz):
    """Key of a chunk, or EMPTY where a coordinate is out of range."""
    x, y, z = cx + COORD_LIMIT, cy + COORD_LIMIT, cz + COORD_LIMIT
    if x < 0 or y < 0 or z < 0 or x >= 2 * COORD_LIMIT or y >= 2 * COORD_LIMIT or z >= 2 * COORD_LIMIT:
        return np.int64(-1)
    return (np.int64(slot) << 45) | (np.int64(x) << 30) | (np.int64(y) << 15) | np.int64(z)


@nb.njit(inline="always")
def local_index(bx, by, bz):
    """Index of a block in its chunk's table."""
    m = CHUNK - 1
    return ((bx & m) << (2 * CHUNK_BITS)) | ((by & m) << CHUNK_BITS) | (bz & m)


@nb.njit(inline="always")
def home(key, mask):
    """First place to probe for a key (Fibonacci hashing of the folded key)."""
    h = np.uint64(key)
    h = (h ^ (h >> np.uint64(29))) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64((h >> np.uint64(32)) & np.uint64(mask))


@nb.njit(cache=True)
def find(keys, values, key):
    """Value of a key, or NONE."""
    mask = keys.shape[0] - 1
    i = home(key, mask)
    while keys[i] != -1:
        if keys[i] == key:
            return values[i]
        i = (i + 1) & mask
    return NONE


@nb.njit(cache=True)
def insert(keys, values, key, value):
    """Insert a key that is not there; the table must have an empty place."""
    mask = keys.shape[0] - 1
    i = home(key, mask)
    while keys[i] != -1:
        i = (i + 1) & mask
    keys[i] = key
    values[i] = value


@nb.njit(cache=True)
def remove(keys, values, key):
    """Remove a key, if there, and shift later entries of its probe sequence back."""
    mask = keys.shape[0] - 1
    i = home(key, mask)
    while keys[i] != key:
        if keys[i] == -1:
            return False
        i = (i + 1) & mask
    j = i
    while True:
        j = (j + 1) & mask
        if keys[j] == -1:
            break
        k = home(keys[j], mask)
        # The entry at j may move to i unless its home lies cyclically in (i, j].
        between = (i < k and k <= j) if i <= j else (i < k or k <= j)
        if not between:
            keys[i] = keys[j]
            values[i] = values[j]
            i = j
    keys[i] = -1
    return True


@nb.njit(cache=True)
def find_block(keys, values, chunk_blocks, slot, bx, by, bz):
    """Pool index of a block of a submap, or NONE."""
    key = chunk_key(slot, bx >> CHUNK_BITS, by >> CHUNK_BITS, bz >> CHUNK_BITS)
    if key == -1:
        return NONE
    chunk = find(keys, values, key)
    if chunk == NONE:
        return NONE
    return chunk_blocks[chunk, local_index(bx, by, bz)]


@nb.njit(cache=True)
def find_blocks(keys, values, chunk_blocks, slot, coords, out):
    """Write the pool index of each of a submap's blocks at coords (N, 3), or NONE, to out (N,)."""
    for n in range(coords.shape[0]):
        out[n] = find_block(keys, values, chunk_blocks, slot, coords[n, 0], coords[n, 1], coords[n, 2])
