"""Projective TSDF integration of one frame into the visible blocks of every submap (method.md section 4)."""

from __future__ import annotations

import numba as nb
import numpy as np

SIDE = 8
FULL = np.float32(32767.0)
"""Fixed point of the distance: +-truncation is +-32767."""
MIN_Z = np.float32(0.05)
COLOR_MEMORY = np.float32(31.0)
"""The colour is a mean over at most about so many frames: 8-bit means stop moving beyond."""


@nb.njit(inline="always")
def sample_range(range_image, u, v, column, row, max_step):
    """Range at pixel coordinates (u, v): bilinear, or the nearest pixel's across a step or beside a hole; 0: none."""
    x0, y0 = int(u), int(v)
    x1, y1 = min(x0 + 1, range_image.shape[1] - 1), min(y0 + 1, range_image.shape[0] - 1)
    a, b, c, d = range_image[y0, x0], range_image[y0, x1], range_image[y1, x0], range_image[y1, x1]
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    if low <= np.float32(0.0) or high - low > max_step:
        return range_image[row, column]
    fx, fy = u - np.float32(x0), v - np.float32(y0)
    top, bottom = a + (b - a) * fx, c + (d - c) * fx
    return top + (bottom - top) * fy


@nb.njit(inline="always")
def count_belonging(belonging, mine):
    """Count one observation in the two 8-bit counters (2,), which are halved together on overflow."""
    k = 0 if mine else 1
    if belonging[k] == 255:
        belonging[0] >>= 1
        belonging[1] >>= 1
    belonging[k] += 1


@nb.njit(cache=True)
def holds_surface(distance, weight, belonging, limit):
    """Whether any voxel of a block (8, 8, 8) is owned and at most `limit` (fixed point) from the surface."""
    for i in range(SIDE):
        for j in range(SIDE):
            for k in range(SIDE):
                if abs(np.int32(distance[i, j, k])) <= limit and weight[i, j, k] > np.float32(0.0):
                    if belonging[i, j, k, 0] >= belonging[i, j, k, 1]:
                        return True
    return False


@nb.njit(cache=True, parallel=True, fastmath=True)
def integrate(
    blocks, range_image, slot_image, color_image, camera, max_step, max_weight, freespace_slot,
    rotations, translations, voxel_sizes, truncations,
    block_coord, block_slot, distance, weight, color, belonging, has_surface, dirty,
):  # fmt: skip
    """Update every voxel of blocks (N,) that projects to a valid pixel and is not behind the truncation band.

    range_image (H, W) along the ray, slot_image (H, W): the submap slot of each pixel (-1: none), color_image
    (H, W, 3), camera (fx, fy, cx, cy). rotations, translations: T_camera_submap of each slot.
    distance (M, 8, 8, 8) int16, weight (M, 8, 8, 8) float32, color (M, 8, 8, 8, 3) and belonging (M, 8, 8, 8, 2)
    uint8, has_surface (M,) and dirty (M,) bool of the pool are written.
    """
    fx, fy, cx, cy = camera
    height, width = range_image.shape
    right, bottom = np.float32(width - 1), np.float32(height - 1)
    for n in nb.prange(blocks.shape[0]):
        block = blocks[n]
        slot = block_slot[block]
        R, t = rotations[slot], translations[slot]
        size, band = voxel_sizes[slot], truncations[slot]
        scale, inv_scale = band / FULL, FULL / band
        focal_area = fx * fy * size * size
        drop = np.float32(1.0) / (band - size)
        freespace = slot == freespace_slot
        ax, ay, az = R[0, 2] * size, R[1, 2] * size, R[2, 2] * size
        touched = False
        for i in range(SIDE):
            a = (np.float32(block_coord[block, 0] * SIDE + i) + np.float32(0.5)) * size
            for j in range(SIDE):
                b = (np.float32(block_coord[block, 1] * SIDE + j) + np.float32(0.5)) * size
                c = (np.float32(block_coord[block, 2] * SIDE) + np.float32(0.5)) * size
                x0 = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + t[0]
                y0 = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + t[1]
                z0 = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + t[2]
                for k in range(SIDE):
                    z = z0 + np.float32(k) * az
                    if z < MIN_Z:
                        continue
                    x, y = x0 + np.float32(k) * ax, y0 + np.float32(k) * ay
                    inv_z = np.float32(1.0) / z
                    u, v = fx * x * inv_z + cx, fy * y * inv_z + cy
                    if not (u >= np.float32(0.0) and v >= np.float32(0.0) and u <= right and v <= bottom):
                        continue
                    column, row = int(u + np.float32(0.5)), int(v + np.float32(0.5))
                    measured = sample_range(range_image, u, v, column, row, max_step)
                    if measured <= np.float32(0.0):
                        continue
                    sdf = measured - np.sqrt(x * x + y * y + z * z)
                    if sdf < -band:
                        continue
                    w = focal_area * inv_z * inv_z * inv_z * inv_z
                    if sdf < -size:
                        w *= (sdf + band) * drop
                    in_band = sdf < band
                    sdf = min(sdf, band)
                    W = weight[block, i, j, k]
                    total = W + w
                    if total <= np.float32(0.0):
                        continue
                    touched = True
                    gain = w / total
                    old = np.float32(distance[block, i, j, k]) * scale
                    new = old + (sdf - old) * gain
                    distance[block, i, j, k] = np.int16(np.rint(new * inv_scale))
                    weight[block, i, j, k] = min(total, max_weight)
                    if freespace or not in_band:
                        continue
                    seen = slot_image[row, column]
                    if seen >= 0:
                        count_belonging(belonging[block, i, j, k], seen == slot)
                    if seen == slot or seen < 0:
                        mine = max(gain, w / min(total, w * COLOR_MEMORY))
                        for q in range(3):
                            was = np.float32(color[block, i, j, k, q])
                            value = was + (np.float32(color_image[row, column, q]) - was) * mine
                            color[block, i, j, k, q] = np.uint8(value + np.float32(0.5))
        if touched:
            dirty[block] = True
            one_voxel = np.int32(FULL * size / band)
            has_surface[block] = holds_surface(distance[block], weight[block], belonging[block], one_voxel)
