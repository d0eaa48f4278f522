"""A submap's surface voxels: where they lie, and giving them up."""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.hashing import NONE, find_block
from uppm._kernels.integrate import belongs

SIDE = 8
FULL = 32767.0


@nb.njit(inline="always")
def on_surface(distance, weight, belonging, limit):
    """Whether a voxel was observed, belongs, and lies at most `limit` (fixed point) from the surface."""
    return weight > 0 and abs(np.int32(distance)) <= limit and belongs(belonging)


@nb.njit(cache=True)
def surface_points(blocks, block_coord, distance, weight, belonging, limit, size, out):
    """Write the surface voxels of one submap's blocks to `out` (N, 4): centre in frame submap, metres, times seen so.

    Returns their number, which may exceed len(out): the rest is not written then.
    """
    count = 0
    for n in range(blocks.shape[0]):
        b = blocks[n]
        for i in range(SIDE):
            for j in range(SIDE):
                for k in range(SIDE):
                    if on_surface(distance[b, i, j, k], weight[b, i, j, k], belonging[b, i, j, k], limit):
                        if count < out.shape[0]:
                            out[count, 0] = (block_coord[b, 0] * SIDE + i + 0.5) * size
                            out[count, 1] = (block_coord[b, 1] * SIDE + j + 0.5) * size
                            out[count, 2] = (block_coord[b, 2] * SIDE + k + 0.5) * size
                            out[count, 3] = belonging[b, i, j, k, 0]
                        count += 1
    return count


@nb.njit(cache=True)
def most_seen(points, slot, keys, values, chunk_blocks, distance, weight, belonging, limit, size, seen):
    """Raise seen (N,) to the times that a submap's surface was seen as its own at points (N, 3), frame submap."""
    for n in range(points.shape[0]):
        x = int(np.floor(points[n, 0] / size))
        y = int(np.floor(points[n, 1] / size))
        z = int(np.floor(points[n, 2] / size))
        b = find_block(keys, values, chunk_blocks, slot, x >> 3, y >> 3, z >> 3)
        if b != NONE:
            i, j, k = x & 7, y & 7, z & 7
            if on_surface(distance[b, i, j, k], weight[b, i, j, k], belonging[b, i, j, k], limit):
                seen[n] = max(seen[n], belonging[b, i, j, k, 0])


@nb.njit(cache=True)
def disown(points, slot, keys, values, chunk_blocks, belonging, dirty, size, reach):
    """Let a submap's voxels at points (N, 3), frame submap, and up to `reach` voxels around belong to another."""
    for n in range(points.shape[0]):
        x = int(np.floor(points[n, 0] / size))
        y = int(np.floor(points[n, 1] / size))
        z = int(np.floor(points[n, 2] / size))
        for i in range(x - reach, x + reach + 1):
            for j in range(y - reach, y + reach + 1):
                for k in range(z - reach, z + reach + 1):
                    b = find_block(keys, values, chunk_blocks, slot, i >> 3, j >> 3, k >> 3)
                    if b != NONE:
                        belonging[b, i & 7, j & 7, k & 7, 0] = 0
                        belonging[b, i & 7, j & 7, k & 7, 1] = 1
                        dirty[b] = True
