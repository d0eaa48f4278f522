"""Rendering of all visible submaps in one pass: how far each agrees with the depth, and with which segments."""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.camera import PARTS, TILE
from uppm._kernels.hashing import NONE, find_block
from uppm._kernels.integrate import belongs

SIDE = 8
FULL = np.float32(32767.0)


@nb.njit(inline="always")
def voxel_at(x, y, z, R, t, inv_size):
    """Voxel coordinates of a point of frame camera in a submap's grid; R, t: T_camera_submap."""
    x, y, z = x - t[0], y - t[1], z - t[2]
    i = np.int32(np.floor((R[0, 0] * x + R[1, 0] * y + R[2, 0] * z) * inv_size))
    j = np.int32(np.floor((R[0, 1] * x + R[1, 1] * y + R[2, 1] * z) * inv_size))
    k = np.int32(np.floor((R[0, 2] * x + R[1, 2] * y + R[2, 2] * z) * inv_size))
    return i, j, k


@nb.njit(cache=True, parallel=True)
def count_overlap(
    tile_slots, tile_count, rows, depth, ray_x, ray_y, ids, stride, keys, values, chunk_blocks,
    rotations, translations, voxel_sizes, truncations, distance, weight, belonging, counts,
):  # fmt: skip
    """Count pixels by submap and segment where the measured point lies on the submap's surface.

    A submap is rendered at a pixel whose measured point falls into a voxel that it owns (weight > 0, belongs) at most
    one voxel from its surface: an inverse rendering with the depth test built in, which leaves no holes.
    tile_slots, tile_count: candidates of each depth tile (`visible_blocks`); rows[slot]: the submap's row in `counts`
    or NONE. Every stride-th pixel both ways. counts (PARTS, submaps, segments + 1) int32 is added to, column 0 for
    unlabeled pixels.
    """
    height, width = depth.shape
    n_rows = tile_count.shape[0]
    for part in nb.prange(PARTS):
        for ty in range(part, n_rows, PARTS):
            for tx in range(tile_count.shape[1]):
                for c in range(tile_count[ty, tx]):
                    slot = tile_slots[ty, tx, c]
                    row = rows[slot]
                    if row == NONE:
                        continue
                    R, t, size = rotations[slot], translations[slot], voxel_sizes[slot]
                    inv_size = np.float32(1.0) / size
                    one_voxel = np.int32(FULL * size / truncations[slot])
                    bx, by, bz, block = np.int32(1 << 30), np.int32(0), np.int32(0), NONE
                    for v in range(ty * TILE, min(height, (ty + 1) * TILE), stride):
                        for u in range(tx * TILE, min(width, (tx + 1) * TILE), stride):
                            d = depth[v, u]
                            if d <= np.float32(0.0):
                                continue
                            i, j, k = voxel_at(ray_x[u] * d, ray_y[v] * d, d, R, t, inv_size)
                            if i >> 3 != bx or j >> 3 != by or k >> 3 != bz:
                                bx, by, bz = i >> 3, j >> 3, k >> 3
                                block = find_block(keys, values, chunk_blocks, slot, bx, by, bz)
                            if block == NONE:
                                continue
                            i, j, k = i & 7, j & 7, k & 7
                            if weight[block, i, j, k] <= np.float32(0.0):
                                continue
                            if abs(np.int32(distance[block, i, j, k])) > one_voxel:
                                continue
                            if belongs(belonging[block, i, j, k]):
                                counts[part, row, ids[v, u]] += 1


@nb.njit(cache=True, parallel=True)
def count_expected(
    blocks, rows, depth, camera, rotations, translations, voxel_sizes, truncations,
    block_coord, block_slot, distance, weight, belonging, counts,
):  # fmt: skip
    """Surface voxels of each submap by what the depth says of them.

    blocks (N,): visible blocks; rows[slot]: the submap's row. counts (PARTS, submaps, 2) int32 is added to:
    [0] measured where expected, [1] seen through (the measured depth is beyond the voxel by more than two voxels).
    Occluded voxels and voxels without depth count as neither.
    """
    fx, fy, cx, cy = camera
    height, width = depth.shape
    half = np.float32(0.5)
    for part in nb.prange(PARTS):
        for m in range(part, blocks.shape[0], PARTS):
            block = blocks[m]
            slot = block_slot[block]
            R, t, size = rotations[slot], translations[slot], voxel_sizes[slot]
            limit = np.int32(FULL * size / truncations[slot] * np.float32(0.6))
            for i in range(SIDE):
                for j in range(SIDE):
                    for k in range(SIDE):
                        if weight[block, i, j, k] <= np.float32(0.0) or abs(np.int32(distance[block, i, j, k])) > limit:
                            continue
                        if not belongs(belonging[block, i, j, k]):
                            continue
                        a = (np.float32(block_coord[block, 0] * SIDE + i) + half) * size
                        b = (np.float32(block_coord[block, 1] * SIDE + j) + half) * size
                        c = (np.float32(block_coord[block, 2] * SIDE + k) + half) * size
                        z = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + t[2]
                        if z < np.float32(0.05):
                            continue
                        x = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + t[0]
                        y = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + t[1]
                        u, v = int(np.floor(fx * x / z + cx + half)), int(np.floor(fy * y / z + cy + half))
                        if u < 0 or v < 0 or u >= width or v >= height or depth[v, u] <= np.float32(0.0):
                            continue
                        difference = depth[v, u] - z
                        if abs(difference) <= np.float32(2.0) * size:
                            counts[part, rows[slot], 0] += 1
                        elif difference > 0:
                            counts[part, rows[slot], 1] += 1
