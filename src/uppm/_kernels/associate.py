"""Rendering of all visible submaps in one pass: how far each agrees with the depth, and with which segments."""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.camera import PARTS, TILE
from uppm._kernels.hashing import NONE, find_block
from uppm._kernels.integrate import belongs

SIDE = 8
VOXELS = SIDE**3
FULL = np.float32(32767.0)


@nb.njit(cache=True)
def tile_points(first_row, first_column, depth, ray_x, ray_y, ids, stride, points, segments):
    """Measured points (3, N), frame camera, and segment ids (N,) of a tile's pixels with depth; their number."""
    xs, ys, zs = points[0], points[1], points[2]
    count = 0
    for v in range(first_row, min(depth.shape[0], first_row + TILE), stride):
        for u in range(first_column, min(depth.shape[1], first_column + TILE), stride):
            d = depth[v, u]
            xs[count], ys[count], zs[count], segments[count] = ray_x[u] * d, ray_y[v] * d, d, ids[v, u]
            count += d > np.float32(0.0)
    return count


@nb.njit(cache=True)
def measure(count, depths, segments, pixels, total):
    """Add the number of points of each segment (N,), and their depth, to pixels and total (segments + 1,)."""
    first = 0
    while first < count:
        segment, last, depth = segments[first], first, 0.0
        while last < count and segments[last] == segment:
            depth += depths[last]
            last += 1
        pixels[segment] += last - first
        total[segment] += depth
        first = last


@nb.njit(cache=True)
def voxels_of(points, count, R, t, inv_size, blocks, inside):
    """Block coordinates (3, N) and index within the block (N,) of points (3, N) in a submap; R, t: T_camera_submap.

    Without branches, so that it is compiled to vector instructions.
    """
    xs, ys, zs = points[0], points[1], points[2]
    bx, by, bz = blocks[0], blocks[1], blocks[2]
    r00, r10, r20 = R[0, 0] * inv_size, R[1, 0] * inv_size, R[2, 0] * inv_size
    r01, r11, r21 = R[0, 1] * inv_size, R[1, 1] * inv_size, R[2, 1] * inv_size
    r02, r12, r22 = R[0, 2] * inv_size, R[1, 2] * inv_size, R[2, 2] * inv_size
    t0, t1, t2 = t[0], t[1], t[2]
    for n in range(count):
        x, y, z = xs[n] - t0, ys[n] - t1, zs[n] - t2
        i = np.int32(np.floor(r00 * x + r10 * y + r20 * z))
        j = np.int32(np.floor(r01 * x + r11 * y + r21 * z))
        k = np.int32(np.floor(r02 * x + r12 * y + r22 * z))
        bx[n], by[n], bz[n] = i >> 3, j >> 3, k >> 3
        inside[n] = ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)


@nb.njit(cache=True)
def count_hits(
    slot, count, blocks, inside, segments, keys, values, chunk_blocks, limit, distance, weight, belonging, counts
):  # fmt: skip
    """Add the points (N,) that fall on a submap's surface to counts (segments + 1,)."""
    xs, ys, zs = blocks[0], blocks[1], blocks[2]
    bx, by, bz, block = np.int32(1 << 30), np.int32(0), np.int32(0), NONE
    for n in range(count):
        if xs[n] != bx or ys[n] != by or zs[n] != bz:
            bx, by, bz = xs[n], ys[n], zs[n]
            block = find_block(keys, values, chunk_blocks, slot, bx, by, bz)
        if block != NONE:
            b, at = np.uint64(block), np.uint32(inside[n])
            if abs(np.int32(distance[b, at])) <= limit and weight[b, at] > np.float32(0.0):
                mine = belonging[b, at, 0]
                counts[segments[n]] += (mine > 0) & (mine >= belonging[b, at, 1])


@nb.njit(cache=True, parallel=True)
def count_overlap(
    tile_slots, tile_count, rows, depth, ray_x, ray_y, ids, stride, keys, values, chunk_blocks,
    rotations, translations, voxel_sizes, truncations, distance, weight, belonging, counts, pixels, total,
):  # fmt: skip
    """Count pixels by submap and segment where the measured point lies on the submap's surface.

    A submap is rendered at a pixel whose measured point falls into a voxel that it owns (weight > 0, belongs) at most
    one voxel from its surface: an inverse rendering with the depth test built in, which leaves no holes.
    tile_slots, tile_count: candidates of each depth tile (`visible_blocks`); rows[slot]: the submap's row in `counts`
    or NONE. Every stride-th pixel both ways. Added to, column 0 for unlabeled pixels: counts (PARTS, submaps, segments
    + 1) int32; pixels (PARTS, segments + 1) int64, each segment's with depth; total, float64, the sum of their depths.
    """
    n_rows = tile_count.shape[0]
    distances, weights = distance.reshape((-1, VOXELS)), weight.reshape((-1, VOXELS))
    owners = belonging.reshape((-1, VOXELS, 2))
    for part in nb.prange(PARTS):
        points, segments = np.empty((3, TILE * TILE), dtype=np.float32), np.empty(TILE * TILE, dtype=np.int32)
        blocks, inside = np.empty((3, TILE * TILE), dtype=np.int32), np.empty(TILE * TILE, dtype=np.int32)
        for ty in range(part, n_rows, PARTS):
            for tx in range(tile_count.shape[1]):
                n = tile_points(ty * TILE, tx * TILE, depth, ray_x, ray_y, ids, stride, points, segments)
                measure(n, points[2], segments, pixels[part], total[part])
                for c in range(tile_count[ty, tx]):
                    slot = tile_slots[ty, tx, c]
                    if rows[slot] == NONE:
                        continue
                    inv_size = np.float32(1.0) / voxel_sizes[slot]
                    limit = np.int32(FULL * voxel_sizes[slot] / truncations[slot])
                    voxels_of(points, n, rotations[slot], translations[slot], inv_size, blocks, inside)
                    count_hits(
                        slot, n, blocks, inside, segments, keys, values, chunk_blocks,
                        limit, distances, weights, owners, counts[part, rows[slot]],
                    )  # fmt: skip


@nb.njit(cache=True)
def nearest_hits(
    slot, row, count, blocks, inside, keys, values, chunk_blocks, limit, scale, distance, weight, belonging, best, rows
):  # fmt: skip
    """Give the points (N,) on a submap's surface its row where no other surface is nearer; best (N,): metres."""
    xs, ys, zs = blocks[0], blocks[1], blocks[2]
    for n in range(count):
        block = find_block(keys, values, chunk_blocks, slot, xs[n], ys[n], zs[n])
        if block == NONE:
            continue
        b, at = np.uint64(block), np.uint32(inside[n])
        off, mine = abs(np.int32(distance[b, at])), belonging[b, at, 0]
        owned = weight[b, at] > np.float32(0.0) and mine > 0 and mine >= belonging[b, at, 1]
        if owned and off <= limit and off * scale < best[n]:
            best[n], rows[n] = off * scale, row


@nb.njit(cache=True, parallel=True)
def render_rows(
    tile_slots, tile_count, rows, depth, ray_x, ray_y, numbers, keys, values, chunk_blocks,
    rotations, translations, voxel_sizes, truncations, distance, weight, belonging, out,
):  # fmt: skip
    """Render the submaps by row: at each pixel the one whose surface is nearest to the measured point.

    As `count_overlap`, at every pixel. numbers (H, W) int32: each pixel's place in the flattened image. out (H * W,)
    int32: set to rows[slot] + 1 where a submap is rendered, else left as it is.
    """
    distances, weights = distance.reshape((-1, VOXELS)), weight.reshape((-1, VOXELS))
    owners = belonging.reshape((-1, VOXELS, 2))
    for part in nb.prange(PARTS):
        points, pixels = np.empty((3, TILE * TILE), dtype=np.float32), np.empty(TILE * TILE, dtype=np.int32)
        blocks, inside = np.empty((3, TILE * TILE), dtype=np.int32), np.empty(TILE * TILE, dtype=np.int32)
        best, found = np.empty(TILE * TILE, dtype=np.float32), np.empty(TILE * TILE, dtype=np.int32)
        for ty in range(part, tile_count.shape[0], PARTS):
            for tx in range(tile_count.shape[1]):
                n = tile_points(ty * TILE, tx * TILE, depth, ray_x, ray_y, numbers, 1, points, pixels)
                best[:n] = np.float32(np.inf)
                found[:n] = NONE
                for c in range(tile_count[ty, tx]):
                    slot = tile_slots[ty, tx, c]
                    if rows[slot] == NONE:
                        continue
                    inv_size = np.float32(1.0) / voxel_sizes[slot]
                    limit = np.int32(FULL * voxel_sizes[slot] / truncations[slot])
                    voxels_of(points, n, rotations[slot], translations[slot], inv_size, blocks, inside)
                    nearest_hits(
                        slot, rows[slot], n, blocks, inside, keys, values, chunk_blocks, limit,
                        truncations[slot] / FULL, distances, weights, owners, best, found,
                    )  # fmt: skip
                for m in range(n):
                    if found[m] != NONE:
                        out[pixels[m]] = found[m] + 1


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
