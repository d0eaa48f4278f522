"""Which blocks a frame needs and the pool lacks: the truncation band of every valid pixel, and freespace along rays."""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.hashing import (
    BLOCKS_PER_CHUNK, CHUNK_BITS, NONE, chunk_key, find, find_block, insert, local_index, remove,
)  # fmt: skip

STRIPES = 16
"""Fixed, so that the order of new blocks does not depend on the number of threads."""


@nb.njit(inline="always")
def band_end(R, t, dx, dy, dz, distance, inv_side):
    """Block coordinates of the point at a distance along a ray of frame camera, in frame submap."""
    x, y, z = dx * distance - t[0], dy * distance - t[1], dz * distance - t[2]
    # R is T_camera_submap's rotation: its transpose takes camera to submap.
    a = np.int64(np.floor((R[0, 0] * x + R[1, 0] * y + R[2, 0] * z) * inv_side))
    b = np.int64(np.floor((R[0, 1] * x + R[1, 1] * y + R[2, 1] * z) * inv_side))
    c = np.int64(np.floor((R[0, 2] * x + R[1, 2] * y + R[2, 2] * z) * inv_side))
    return a, b, c


@nb.njit(cache=True, parallel=True)
def missing_blocks(
    range_image, rays, slot_image, keys, values, chunk_blocks,
    rotations, translations, voxel_sizes, truncations, out, counts,
):  # fmt: skip
    """Blocks that the truncation bands touch and that do not exist.

    For each valid pixel the blocks in the box of its band's two ends are looked up: the band is half a block long, so
    the box is at most 2x2x2 and holds every block that the band crosses. Pixels whose box equals their left
    neighbour's are skipped. out (STRIPES, N, 4) takes (slot, bx, by, bz), counts (STRIPES,) their number; repeats
    are possible. A stripe that is full stops: the caller grows `out` and calls again.
    """
    height, width = range_image.shape
    for stripe in nb.prange(STRIPES):
        count = 0
        previous = np.full(7, -1 << 40, dtype=np.int64)
        for row in range(stripe * height // STRIPES, (stripe + 1) * height // STRIPES):
            for column in range(width):
                distance = range_image[row, column]
                slot = slot_image[row, column]
                if distance == 0 or slot < 0:
                    continue
                scale = rays[row, column, 2] / np.sqrt(
                    rays[row, column, 0] ** 2 + rays[row, column, 1] ** 2 + rays[row, column, 2] ** 2
                )
                dx, dy, dz = rays[row, column, 0] * scale, rays[row, column, 1] * scale, scale
                inv_side = np.float32(1.0) / (voxel_sizes[slot] * np.float32(8.0))
                R, t, band = rotations[slot], translations[slot], truncations[slot]
                x0, y0, z0 = band_end(R, t, dx, dy, dz, distance - band, inv_side)
                x1, y1, z1 = band_end(R, t, dx, dy, dz, distance + band, inv_side)
                x0, x1 = min(x0, x1), max(x0, x1)
                y0, y1 = min(y0, y1), max(y0, y1)
                z0, z1 = min(z0, z1), max(z0, z1)
                if (
                    previous[0] == slot and previous[1] == x0 and previous[2] == y0 and previous[3] == z0
                    and previous[4] == x1 and previous[5] == y1 and previous[6] == z1
                ):  # fmt: skip
                    continue
                previous[0], previous[1], previous[2], previous[3] = slot, x0, y0, z0
                previous[4], previous[5], previous[6] = x1, y1, z1
                for bx in range(x0, x1 + 1):
                    for by in range(y0, y1 + 1):
                        for bz in range(z0, z1 + 1):
                            if count < out.shape[1] and (
                                find_block(keys, values, chunk_blocks, slot, bx, by, bz) == NONE
                            ):
                                out[stripe, count, 0], out[stripe, count, 1] = slot, bx
                                out[stripe, count, 2], out[stripe, count, 3] = by, bz
                                count += 1
        counts[stripe] = count


@nb.njit(cache=True)
def missing_along_rays(range_image, rays, stride, slot, keys, values, chunk_blocks, R, t, side, band, out):
    """As `missing_blocks`, for the freespace submap: every block from the camera to the band's end, each stride-th ray.

    Steps are half a block; neighbouring rays are much closer than a block, so nothing is missed. Returns the count.
    """
    count = 0
    inv_side = np.float32(1.0) / side
    for row in range(0, range_image.shape[0], stride):
        for column in range(0, range_image.shape[1], stride):
            distance = range_image[row, column]
            if distance == 0:
                continue
            a, b, c = rays[row, column, 0], rays[row, column, 1], rays[row, column, 2]
            scale = np.float32(1.0) / np.sqrt(a * a + b * b + c * c)
            end = distance + band
            steps = int(np.ceil(end / (side * np.float32(0.5))))
            for i in range(steps + 1):
                x, y, z = band_end(R, t, a * scale, b * scale, c * scale, end * np.float32(i) / steps, inv_side)
                if count < out.shape[0] and find_block(keys, values, chunk_blocks, slot, x, y, z) == NONE:
                    out[count, 0], out[count, 1], out[count, 2], out[count, 3] = slot, x, y, z
                    count += 1
                    # Found again by the next ray unless it exists by then: keep the list short.
                    if count > 1 and same_row(out, count - 1, count - 2):
                        count -= 1
    return count


@nb.njit(inline="always")
def same_row(rows, i, j):
    return rows[i, 0] == rows[j, 0] and rows[i, 1] == rows[j, 1] and rows[i, 2] == rows[j, 2] and rows[i, 3] == rows[j, 3]


@nb.njit(cache=True)
def add_blocks(
    wanted, n, keys, values, head, chunk_next, chunk_prev, chunk_coord, chunk_slot, chunk_blocks, chunk_used, free_chunks,
    block_coord, block_slot, free_blocks, state, out,
):  # fmt: skip
    """Create the blocks of wanted[:n] (slot, bx, by, bz) that do not exist; write their pool indices to `out`.

    state (4,): free blocks left, free chunks left, chunks used, blocks out of the addressable range (counted up).
    Returns the number of new blocks, or -1 where the pool or the table is full (nothing more is added then).
    """
    count = 0
    for i in range(n):
        slot, bx, by, bz = wanted[i, 0], wanted[i, 1], wanted[i, 2], wanted[i, 3]
        cx, cy, cz = bx >> CHUNK_BITS, by >> CHUNK_BITS, bz >> CHUNK_BITS
        key = chunk_key(slot, cx, cy, cz)
        if key == -1:
            state[3] += 1
            continue
        chunk = find(keys, values, key)
        if chunk == NONE:
            if state[1] == 0:
                return -1
            state[1] -= 1
            state[2] += 1
            chunk = free_chunks[state[1]]
            insert(keys, values, key, chunk)
            chunk_coord[chunk, 0], chunk_coord[chunk, 1], chunk_coord[chunk, 2] = cx, cy, cz
            chunk_slot[chunk], chunk_used[chunk] = slot, 0
            for k in range(BLOCKS_PER_CHUNK):
                chunk_blocks[chunk, k] = NONE
            chunk_next[chunk], chunk_prev[chunk] = head[slot], NONE
            if head[slot] != NONE:
                chunk_prev[head[slot]] = chunk
            head[slot] = chunk
        k = local_index(bx, by, bz)
        if chunk_blocks[chunk, k] != NONE:
            continue
        if state[0] == 0:
            return -1
        state[0] -= 1
        block = free_blocks[state[0]]
        chunk_blocks[chunk, k] = block
        chunk_used[chunk] += 1
        block_coord[block, 0], block_coord[block, 1], block_coord[block, 2] = bx, by, bz
        block_slot[block] = slot
        out[count] = block
        count += 1
    return count


@nb.njit(cache=True)
def drop_blocks(
    blocks, keys, values, head, chunk_next, chunk_prev, chunk_coord, chunk_slot, chunk_blocks, chunk_used, free_chunks,
    block_coord, block_slot, free_blocks, state,
):  # fmt: skip
    """Return blocks to the pool, and chunks that they leave empty."""
    for i in range(blocks.shape[0]):
        block = blocks[i]
        slot = block_slot[block]
        bx, by, bz = block_coord[block, 0], block_coord[block, 1], block_coord[block, 2]
        key = chunk_key(slot, bx >> CHUNK_BITS, by >> CHUNK_BITS, bz >> CHUNK_BITS)
        chunk = find(keys, values, key)
        chunk_blocks[chunk, local_index(bx, by, bz)] = NONE
        chunk_used[chunk] -= 1
        block_slot[block] = NONE
        free_blocks[state[0]] = block
        state[0] += 1
        if chunk_used[chunk] == 0:
            remove(keys, values, key)
            after, before = chunk_next[chunk], chunk_prev[chunk]
            if before == NONE:
                head[slot] = after
            else:
                chunk_next[before] = after
            if after != NONE:
                chunk_prev[after] = before
            free_chunks[state[1]] = chunk
            state[1] += 1
            state[2] -= 1
