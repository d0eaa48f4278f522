"""Rendering of all visible submaps in one pass: how far each agrees with the depth, and with which segments."""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.camera import sphere_footprint

SIDE = 8
FULL = np.float32(32767.0)
PARTS = 8
"""Fixed, so that sums do not depend on the number of threads."""


@nb.njit(cache=True, parallel=True, fastmath=True)
def count_overlap(
    blocks, local, depth, rays, ids, stride, camera, rotations, translations, voxel_sizes, truncations,
    block_coord, block_slot, distance, weight, belonging, counts,
):  # fmt: skip
    """Count pixels by submap and segment where the measured point lies on the submap's surface.

    A submap is rendered at a pixel whose measured point falls into a voxel that it owns (weight > 0, belongs) at most
    one voxel from its surface: an inverse rendering with the depth test built in, which leaves no holes.
    blocks (N,): visible blocks with a surface; local[slot]: the submap's row. Every stride-th pixel both ways.
    counts (PARTS, rows, segments + 1) int32 is added to, column 0 for unlabeled pixels.
    """
    height, width = depth.shape
    n = blocks.shape[0]
    for part in nb.prange(PARTS):
        box = np.empty(4, dtype=np.int64)
        for m in range(part, n, PARTS):
            block = blocks[m]
            slot = block_slot[block]
            row_of = local[slot]
            R, t, size = rotations[slot], translations[slot], voxel_sizes[slot]
            inv_size = np.float32(1.0) / size
            half = np.float32(SIDE * 0.5) * size
            ox, oy, oz = block_coord[block, 0] * SIDE, block_coord[block, 1] * SIDE, block_coord[block, 2] * SIDE
            a, b, c = np.float32(ox) * size + half, np.float32(oy) * size + half, np.float32(oz) * size + half
            x = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + t[0]
            y = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + t[1]
            z = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + t[2]
            radius = half * np.float32(1.7321)
            if not sphere_footprint(x, y, z, radius, camera, (height, width), box):
                continue
            one_voxel = np.int32(FULL * size / truncations[slot])
            nearest, farthest = z - radius, z + radius
            for v in range((box[1] + stride - 1) // stride * stride, box[3], stride):
                for u in range((box[0] + stride - 1) // stride * stride, box[2], stride):
                    d = depth[v, u]
                    if not (d > nearest and d < farthest):
                        continue
                    px, py, pz = rays[v, u, 0] * d - t[0], rays[v, u, 1] * d - t[1], d - t[2]
                    i = int(np.floor((R[0, 0] * px + R[1, 0] * py + R[2, 0] * pz) * inv_size)) - ox
                    if i < 0 or i >= SIDE:
                        continue
                    j = int(np.floor((R[0, 1] * px + R[1, 1] * py + R[2, 1] * pz) * inv_size)) - oy
                    if j < 0 or j >= SIDE:
                        continue
                    k = int(np.floor((R[0, 2] * px + R[1, 2] * py + R[2, 2] * pz) * inv_size)) - oz
                    if k < 0 or k >= SIDE:
                        continue
                    if weight[block, i, j, k] <= np.float32(0.0):
                        continue
                    near_surface = abs(np.int32(distance[block, i, j, k])) <= one_voxel
                    if near_surface and belonging[block, i, j, k, 0] >= belonging[block, i, j, k, 1]:
                        counts[part, row_of, ids[v, u]] += 1


@nb.njit(cache=True, parallel=True, fastmath=True)
def count_expected(
    blocks, local, depth, camera, rotations, translations, voxel_sizes, truncations,
    block_coord, block_slot, distance, weight, belonging, counts,
):  # fmt: skip
    """Surface voxels of each submap by what the depth says of them.

    counts (PARTS, rows, 2) int32 is added to: [0] measured where expected, [1] seen through (the measured depth is
    beyond the voxel by more than two voxels). Occluded voxels and voxels without depth count as neither.
    """
    fx, fy, cx, cy = camera
    height, width = depth.shape
    for part in nb.prange(PARTS):
        for m in range(part, blocks.shape[0], PARTS):
            block = blocks[m]
            slot = block_slot[block]
            R, t, size = rotations[slot], translations[slot], voxel_sizes[slot]
            half_voxel = np.int32(FULL * size / truncations[slot] * np.float32(0.5))
            for i in range(SIDE):
                for j in range(SIDE):
                    for k in range(SIDE):
                        if weight[block, i, j, k] <= np.float32(0.0) or abs(np.int32(distance[block, i, j, k])) > half_voxel:
                            continue
                        if belonging[block, i, j, k, 0] < belonging[block, i, j, k, 1]:
                            continue
                        a = (np.float32(block_coord[block, 0] * SIDE + i) + np.float32(0.5)) * size
                        b = (np.float32(block_coord[block, 1] * SIDE + j) + np.float32(0.5)) * size
                        c = (np.float32(block_coord[block, 2] * SIDE + k) + np.float32(0.5)) * size
                        z = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + t[2]
                        if z < np.float32(0.05):
                            continue
                        x = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + t[0]
                        y = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + t[1]
                        u, v = int(np.floor(fx * x / z + cx + 0.5)), int(np.floor(fy * y / z + cy + 0.5))
                        if u < 0 or v < 0 or u >= width or v >= height or depth[v, u] <= np.float32(0.0):
                            continue
                        difference = depth[v, u] - z
                        if abs(difference) <= np.float32(2.0) * size:
                            counts[part, local[slot], 0] += 1
                        elif difference > 0:
                            counts[part, local[slot], 1] += 1
