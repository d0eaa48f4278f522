"""Which blocks a frame can touch: submaps, then their chunks, then their blocks, against frustum and depth."""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.camera import TILE, sphere_footprint
from uppm._kernels.hashing import BLOCKS_PER_CHUNK, CHUNK, NONE

HALF_DIAGONAL = np.sqrt(3.0) / 2.0
SIDE = 8


@nb.njit(cache=True)
def visible_blocks(
    slots, head, chunk_next, chunk_coord, chunk_blocks, block_coord, has_surface,
    rotations, translations, voxel_sizes, truncations, camera, shape, depth_max, tile_min, tile_max, out,
):  # fmt: skip
    """Write the pool indices of the blocks that this frame's rays can update to `out`; return their number.

    slots (S,): submaps to look at; head[slot]: a submap's first chunk, chunk_next: the next of the same submap.
    rotations (slot, 3, 3), translations (slot, 3): T_camera_submap. A block counts where its bounding cube is in the
    frustum and not wholly behind the surface; wholly in front of it only where it holds a surface to carve.
    """
    box = np.empty(4, dtype=np.int64)
    count = 0
    for s in range(slots.shape[0]):
        slot = slots[s]
        side = voxel_sizes[slot] * SIDE
        chunk_side = side * CHUNK
        chunk = head[slot]
        while chunk != NONE:
            x, y, z = center_in_camera(chunk_coord[chunk], chunk_side, rotations[slot], translations[slot])
            radius = chunk_side * HALF_DIAGONAL
            if z - radius <= depth_max + truncations[slot] and sphere_footprint(x, y, z, radius, camera, shape, box):
                for k in range(BLOCKS_PER_CHUNK):
                    block = chunk_blocks[chunk, k]
                    if block == NONE:
                        continue
                    x, y, z = center_in_camera(block_coord[block], side, rotations[slot], translations[slot])
                    radius = side * HALF_DIAGONAL
                    if not sphere_footprint(x, y, z, radius, camera, shape, box):
                        continue
                    reach = radius + truncations[slot]
                    low, high = depth_bounds(box, tile_min, tile_max)
                    if z - reach <= high and (has_surface[block] or z + reach >= low):
                        out[count] = block
                        count += 1
            chunk = chunk_next[chunk]
    return count


@nb.njit(inline="always")
def center_in_camera(coord, side, R, t):
    """Centre of a cube of a grid in frame camera."""
    a, b, c = (coord[0] + 0.5) * side, (coord[1] + 0.5) * side, (coord[2] + 0.5) * side
    x = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + t[0]
    y = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + t[1]
    z = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + t[2]
    return x, y, z


@nb.njit(inline="always")
def depth_bounds(box, tile_min, tile_max):
    """Least and greatest valid depth in the tiles that a pixel box touches."""
    low, high = np.float32(np.inf), np.float32(0.0)
    for ty in range(box[1] // TILE, (box[3] - 1) // TILE + 1):
        for tx in range(box[0] // TILE, (box[2] - 1) // TILE + 1):
            low = min(low, tile_min[ty, tx])
            high = max(high, tile_max[ty, tx])
    return low, high
