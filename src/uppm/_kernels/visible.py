"""Which blocks a frame can touch: submaps, then their chunks, then their blocks, against frustum and depth."""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.camera import TILE, sphere_footprint
from uppm._kernels.hashing import BLOCKS_PER_CHUNK, CHUNK, NONE

HALF_DIAGONAL = np.float32(np.sqrt(3.0) / 2.0)
SIDE = 8
MAX_CANDIDATES = 48
"""Submaps that can be told apart within one depth tile."""


@nb.njit(cache=True)
def visible_blocks(
    slots, head, chunk_next, chunk_coord, chunk_blocks, block_coord, has_surface,
    rotations, translations, voxel_sizes, truncations, camera, shape, depth_max, tile_min, tile_max,
    freespace_slot, out, boxes, tile_slots, tile_count,
):  # fmt: skip
    """Write the pool indices of the blocks that this frame's rays can update to `out`; return their number.

    slots (S,): submaps to look at; head[slot]: a submap's first chunk, chunk_next: the next of the same submap.
    rotations (slot, 3, 3), translations (slot, 3): T_camera_submap. A block counts where its bounding sphere is in the
    frustum and not wholly behind the surface; wholly in front of it only where it holds a
    surface to carve, or is freespace.
    boxes (N, 4): the depth tiles x0, y0, x1, y1 (ends exclusive) that each block projects to; written.
    tile_slots (rows, columns, MAX_CANDIDATES), tile_count (rows, columns): the submaps of which a block with a surface
    meets the tile's depth; written.
    """
    box = np.empty(4, dtype=np.int64)
    count = 0
    tile_count[:] = 0
    for s in range(slots.shape[0]):
        slot = slots[s]
        R, t, band = rotations[slot], translations[slot], truncations[slot]
        side = voxel_sizes[slot] * np.float32(SIDE)
        chunk_side = side * np.float32(CHUNK)
        chunk = head[slot]
        while chunk != NONE:
            x, y, z = center_in_camera(chunk_coord[chunk], chunk_side, R, t)
            radius = chunk_side * HALF_DIAGONAL
            if z - radius <= depth_max + band and sphere_footprint(x, y, z, radius, camera, shape, box):
                for k in range(BLOCKS_PER_CHUNK):
                    block = chunk_blocks[chunk, k]
                    if block == NONE:
                        continue
                    x, y, z = center_in_camera(block_coord[block], side, R, t)
                    radius = side * HALF_DIAGONAL
                    if not sphere_footprint(x, y, z, radius, camera, shape, box):
                        continue
                    surface = has_surface[block]
                    carve = surface or slot == freespace_slot
                    if meets_depth(box, z, radius, band, tile_min, tile_max, carve):
                        out[count] = block
                        boxes[count, 0], boxes[count, 1] = box[0] // TILE, box[1] // TILE
                        boxes[count, 2], boxes[count, 3] = (box[2] - 1) // TILE + 1, (box[3] - 1) // TILE + 1
                        count += 1
                        if surface:
                            add_candidate(box, z, radius, slot, tile_min, tile_max, tile_slots, tile_count)
            chunk = chunk_next[chunk]
    return count


@nb.njit(inline="always")
def center_in_camera(coord, side, R, t):
    """Centre of a cube of a grid in frame camera."""
    half = np.float32(0.5)
    a, b, c = (coord[0] + half) * side, (coord[1] + half) * side, (coord[2] + half) * side
    x = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + t[0]
    y = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + t[1]
    z = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + t[2]
    return x, y, z


@nb.njit(cache=True)
def meets_depth(box, z, radius, band, tile_min, tile_max, carve):
    """Whether some tile of a pixel box sees a sphere: not behind its greatest depth, nor before its least."""
    reach = radius + band
    for ty in range(box[1] // TILE, (box[3] - 1) // TILE + 1):
        for tx in range(box[0] // TILE, (box[2] - 1) // TILE + 1):
            if z - reach <= tile_max[ty, tx] and (carve or z + reach >= tile_min[ty, tx]):
                return True
    return False


@nb.njit(cache=True)
def add_candidate(box, z, radius, slot, tile_min, tile_max, tile_slots, tile_count):
    """List a submap in the tiles whose depth a sphere of it meets."""
    for ty in range(box[1] // TILE, (box[3] - 1) // TILE + 1):
        for tx in range(box[0] // TILE, (box[2] - 1) // TILE + 1):
            if z - radius > tile_max[ty, tx] or z + radius < tile_min[ty, tx]:
                continue
            n = tile_count[ty, tx]
            # Submaps come one after the other: a repeat can only be the last.
            if n < MAX_CANDIDATES and (n == 0 or tile_slots[ty, tx, n - 1] != slot):
                tile_slots[ty, tx, n] = slot
                tile_count[ty, tx] = n + 1


@nb.njit(cache=True)
def blocks_to_update(blocks, boxes, has_surface, block_slot, rows, present, freespace_slot, out):
    """Of the visible blocks (N,), those in which the frame can change a surface; their number is returned.

    A block without a surface of its submap gains one only from a pixel of that submap; present (tiles down, tiles
    across, submaps): which tiles show one of submap rows[slot]. Freespace is always updated.
    A block that was freed meanwhile, or whose submap has rows[slot] == NONE, is left out.
    """
    count = 0
    for n in range(blocks.shape[0]):
        slot = block_slot[blocks[n]]
        if slot == NONE or (slot != freespace_slot and rows[slot] == NONE):
            continue
        wanted = has_surface[blocks[n]] or slot == freespace_slot
        if not wanted:
            for ty in range(boxes[n, 1], boxes[n, 3]):
                for tx in range(boxes[n, 0], boxes[n, 2]):
                    wanted = wanted or present[ty, tx, rows[slot]]
        if wanted:
            out[count] = blocks[n]
            count += 1
    return count
