"""Which blocks a frame needs and the pool lacks: the truncation band of every valid pixel, and freespace along rays."""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.camera import TILE
from uppm._kernels.hashing import (
    BLOCKS_PER_CHUNK,
    CHUNK_BITS,
    NONE,
    chunk_key,
    find,
    find_block,
    insert,
    local_index,
    remove,
)  # fmt: skip

NOWHERE = np.int32(-(1 << 31))
"""In place of a block coordinate: the pixel has no depth or no submap."""


@nb.njit(inline="always")
def band_end(R, t, dx, dy, dz, distance, inv_side):
    """Block coordinates of the point at a distance along a ray of frame camera, in frame submap."""
    x, y, z = dx * distance - t[0], dy * distance - t[1], dz * distance - t[2]
    # R is T_camera_submap's rotation: its transpose takes camera to submap.
    a = np.int32(np.floor((R[0, 0] * x + R[1, 0] * y + R[2, 0] * z) * inv_side))
    b = np.int32(np.floor((R[0, 1] * x + R[1, 1] * y + R[2, 1] * z) * inv_side))
    c = np.int32(np.floor((R[0, 2] * x + R[1, 2] * y + R[2, 2] * z) * inv_side))
    return a, b, c


@nb.njit(cache=True, error_model="numpy")
def band_blocks(first, last, depth, ray_x, b, R, t, band, inv_side, ends):
    """Block coordinates of the near and far band ends of pixels [first, last) of a row; ends (6, W) is written.

    The ray of pixel u is (ray_x[u], b, 1). Without branches, so that it is compiled to vector instructions. A pixel
    without depth gives NOWHERE.
    """
    m00, m01, m02 = R[0, 0] * inv_side, R[1, 0] * inv_side, R[2, 0] * inv_side
    m10, m11, m12 = R[0, 1] * inv_side, R[1, 1] * inv_side, R[2, 1] * inv_side
    m20, m21, m22 = R[0, 2] * inv_side, R[1, 2] * inv_side, R[2, 2] * inv_side
    ox = m00 * t[0] + m01 * t[1] + m02 * t[2]
    oy = m10 * t[0] + m11 * t[1] + m12 * t[2]
    oz = m20 * t[0] + m21 * t[1] + m22 * t[2]
    x0, y0, z0, x1, y1, z1 = ends[0], ends[1], ends[2], ends[3], ends[4], ends[5]
    bx, by, bz, bb = m01 * b + m02, m11 * b + m12, m21 * b + m22, b * b + np.float32(1.0)
    for n in range(last - first):
        u = np.uint64(first + n)
        a, d = ray_x[u], depth[u]
        step = band / np.sqrt(a * a + bb)
        x, y, z = m00 * a + bx, m10 * a + by, m20 * a + bz
        near, far = d - step, d + step
        valid = d > np.float32(0.0)
        x0[u] = np.int32(np.floor(x * near - ox)) if valid else NOWHERE
        y0[u] = np.int32(np.floor(y * near - oy))
        z0[u] = np.int32(np.floor(z * near - oz))
        x1[u] = np.int32(np.floor(x * far - ox))
        y1[u] = np.int32(np.floor(y * far - oy))
        z1[u] = np.int32(np.floor(z * far - oz))


@nb.njit(cache=True)
def differs(ends, slots, others, other_slots, shift, out):
    """out[u]: whether pixel u of a row has another slot or other band ends than pixel u - shift of another row."""
    a0, a1, a2, a3, a4, a5 = ends[0], ends[1], ends[2], ends[3], ends[4], ends[5]
    b0, b1, b2, b3, b4, b5 = others[0], others[1], others[2], others[3], others[4], others[5]
    for n in range(out.shape[0] - shift):
        v = np.uint64(n)
        u = np.uint64(n + shift)
        same = (a0[u] == b0[v]) & (a1[u] == b1[v]) & (a2[u] == b2[v]) & (a3[u] == b3[v]) & (a4[u] == b4[v])
        out[u] = not (same & (a5[u] == b5[v]) & (slots[u] == other_slots[v]))


@nb.njit(cache=True)
def keep_new(near_x, left_new, new):
    """Of the pixels that are new against the row above, those that are so against their left too and have depth."""
    for u in range(new.shape[0]):
        new[u] = new[u] & left_new[u] & (near_x[u] != NOWHERE)


@nb.njit(cache=True)
def add_missing(slot, ends, u, keys, values, chunk_blocks, out, count):
    """Append the blocks between the band ends of pixel u that do not exist to out (N, 4); returns the new count."""
    x0, x1 = min(ends[0, u], ends[3, u]), max(ends[0, u], ends[3, u])
    y0, y1 = min(ends[1, u], ends[4, u]), max(ends[1, u], ends[4, u])
    z0, z1 = min(ends[2, u], ends[5, u]), max(ends[2, u], ends[5, u])
    for bx in range(x0, x1 + 1):
        for by in range(y0, y1 + 1):
            for bz in range(z0, z1 + 1):
                if find_block(keys, values, chunk_blocks, slot, bx, by, bz) == NONE and count < out.shape[0]:
                    out[count, 0], out[count, 1], out[count, 2], out[count, 3] = slot, bx, by, bz
                    count += 1
    return count


@nb.njit(cache=True)
def look_up_row(ids, slot_of, number_of, slots, numbers):
    """Slot and submap id of each pixel (W,) of a row by its segment id."""
    for u in range(ids.shape[0]):
        k = np.uint32(ids[u])
        slots[u], numbers[u] = slot_of[k], number_of[k]


@nb.njit(cache=True)
def row_ends(
    depth, ray_x, ray_y, slots, rotations, translations, voxel_sizes, truncations, rows, ends, present
):  # fmt: skip
    """`band_blocks` for a row, one run of pixels with the same slot after the other; NOWHERE where there is none.

    present (tiles across, submaps): marked where a run of submap rows[slot] crosses a tile.
    """
    first = 0
    while first < depth.shape[0]:
        slot, last = slots[first], first + 1
        while last < depth.shape[0] and slots[last] == slot:
            last += 1
        if slot >= 0:
            inv_side = np.float32(1.0) / (voxel_sizes[slot] * np.float32(8.0))
            R, t, band = rotations[slot], translations[slot], truncations[slot]
            band_blocks(first, last, depth, ray_x, ray_y, R, t, band, inv_side, ends)
            if rows[slot] != NONE:
                present[first // TILE : (last - 1) // TILE + 1, rows[slot]] = True
        else:
            ends[0, first:last] = NOWHERE
        first = last


@nb.njit(cache=True, parallel=True)
def missing_blocks(
    ids, slot_of, number_of, depth, ray_x, ray_y, keys, values, chunk_blocks,
    rotations, translations, voxel_sizes, truncations, rows, slot_image, number_image, present, out, counts,
):  # fmt: skip
    """Give each pixel its submap, and find the blocks that the truncation bands touch and that do not exist.

    ids (H, W): segments; slot_of, number_of: a segment's slot (or NONE) and submap id; slot_image, number_image (H, W)
    are written, and present (tiles down, tiles across, submaps): whether a tile shows the submap rows[slot].
    For each valid pixel the blocks in the box of its band's two ends are looked up: the band is half a block long, so
    the box is at most 2x2x2 and holds every block that the band crosses. Pixels whose ends equal those of the pixel
    to their left or above are skipped. out (tiles down, N, 4) takes (slot, bx, by, bz), counts (tiles down,) their
    number; repeats are possible. A row of tiles that is full stops: the caller grows `out` and calls again.
    """
    height, width = depth.shape
    for ty in nb.prange(present.shape[0]):
        count = 0
        ends, above = np.empty((6, width), dtype=np.int32), np.full((6, width), NOWHERE, dtype=np.int32)
        left_new, padded = np.ones(width, dtype=np.bool_), np.zeros(-(-width // 8) * 8, dtype=np.bool_)
        new, words = padded[:width], padded.view(np.uint64)
        present[ty] = False
        for row in range(ty * TILE, min(height, (ty + 1) * TILE)):
            slots = slot_image[row]
            look_up_row(ids[row], slot_of, number_of, slots, number_image[row])
            row_ends(
                depth[row], ray_x, ray_y[row], slots, rotations, translations, voxel_sizes, truncations,
                rows, ends, present[ty],
            )  # fmt: skip
            differs(ends, slots, ends, slots, 1, left_new)
            differs(ends, slots, above, slot_image[max(row - 1, ty * TILE)], 0, new)
            keep_new(ends[0], left_new, new)
            # Few pixels are new: eight are passed over at a time.
            for word in range(words.shape[0]):
                if words[word] != 0:
                    for u in range(8 * word, min(8 * word + 8, width)):
                        if new[u]:
                            count = add_missing(slots[u], ends, u, keys, values, chunk_blocks, out[ty], count)
            ends, above = above, ends
        counts[ty] = count


@nb.njit(cache=True)
def missing_along_rays(range_image, ray_x, ray_y, stride, slot, keys, values, chunk_blocks, R, t, side, band, out):
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
            a, b = ray_x[column], ray_y[row]
            scale = np.float32(1.0) / np.sqrt(a * a + b * b + np.float32(1.0))
            end = distance + band
            steps = int(np.ceil(end / (side * np.float32(0.5))))
            for i in range(steps + 1):
                x, y, z = band_end(R, t, a * scale, b * scale, scale, end * np.float32(i) / steps, inv_side)
                if count < out.shape[0] and find_block(keys, values, chunk_blocks, slot, x, y, z) == NONE:
                    out[count, 0], out[count, 1], out[count, 2], out[count, 3] = slot, x, y, z
                    count += 1
                    # Found again by the next ray unless it exists by then: keep the list short.
                    if count > 1 and same_row(out, count - 1, count - 2):
                        count -= 1
    return count


@nb.njit(inline="always")
def same_row(rows, i, j):
    return (
        rows[i, 0] == rows[j, 0] and rows[i, 1] == rows[j, 1] and rows[i, 2] == rows[j, 2] and rows[i, 3] == rows[j, 3]
    )


@nb.njit(cache=True)
def add_blocks(
    wanted, n, keys, values, head, chunk_next, chunk_prev, chunk_coord, chunk_slot, chunk_blocks, chunk_used,
    free_chunks, block_coord, block_slot, free_blocks, state, out,
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
