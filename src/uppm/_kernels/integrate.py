"""Projective TSDF integration of one frame into the visible blocks of every submap (method.md section 4)."""

from __future__ import annotations

import numba as nb
import numpy as np

SIDE = 8
FULL = np.float32(32767.0)
"""Fixed point of the distance: +-truncation is +-32767."""
BEHIND = np.float32(2.0)
"""Truncation distances along the ray at which a surface, however it is met, hides what is behind it."""
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


@nb.njit(inline="always")
def belongs(belonging):
    """Whether a voxel's surface is the submap's: seen so at least once, and as often as another's."""
    return belonging[0] > 0 and belonging[0] >= belonging[1]


@nb.njit(inline="always")
def mix_color(color, seen, gain):
    """Move a colour (3,) towards the one seen; 8 bits, rounded."""
    for q in range(3):
        was = np.float32(color[q])
        color[q] = np.uint8(was + (np.float32(seen[q]) - was) * gain + np.float32(0.5))


@nb.njit(cache=True)
def holds_surface(distance, weight, belonging, limit):
    """Whether any voxel of a block (8, 8, 8) is owned and at most `limit` (fixed point) from the surface."""
    for i in range(SIDE):
        for j in range(SIDE):
            for k in range(SIDE):
                near = weight[i, j, k] > np.float32(0.0) and abs(np.int32(distance[i, j, k])) <= limit
                if near and belongs(belonging[i, j, k]):
                    return True
    return False


@nb.njit(cache=True)
def project_slab(a, coord, R, t, size, camera, u, v, inverse, far):
    """Project the 64 voxels of a block's slab at submap coordinate a along x.

    Writes pixel coordinates u, v, 1 / z (0 behind the camera) and the distance from the camera, each (64,). Without
    branches, so that it is compiled to vector instructions.
    """
    fx, fy, cx, cy = camera
    half = np.float32(0.5)
    for j in range(SIDE):
        b = (np.float32(coord[1] * SIDE + j) + half) * size
        c = (np.float32(coord[2] * SIDE) + half) * size
        x0 = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + t[0]
        y0 = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + t[1]
        z0 = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + t[2]
        ax, ay, az = R[0, 2] * size, R[1, 2] * size, R[2, 2] * size
        for k in range(SIDE):
            step = np.float32(k)
            x, y, z = x0 + step * ax, y0 + step * ay, z0 + step * az
            inv_z = np.float32(1.0) / max(z, MIN_Z)
            n = j * SIDE + k
            u[n] = fx * x * inv_z + cx
            v[n] = fy * y * inv_z + cy
            inverse[n] = inv_z if z > MIN_Z else np.float32(0.0)
            far[n] = np.sqrt(x * x + y * y + z * z)


@nb.njit(inline="always")
def signed_distance(range_image, cosine, u, v, column, row, far, band, max_step):
    """Distance of a voxel in front of the measured surface; band where more, below -band where not to be updated.

    far: the voxel's distance from the camera. Interpolation moves the range by at most max_step, so that most voxels
    are decided by the nearest pixel.
    """
    nearest, incidence = range_image[row, column], cosine[row >> 1, column >> 1]
    reach = band / incidence + max_step
    if nearest <= np.float32(0.0) or nearest - far < -reach:
        return np.float32(-2.0) * band
    if nearest - far > reach:
        return band
    along = sample_range(range_image, u, v, column, row, max_step) - far
    if along < -BEHIND * band:
        return np.float32(-2.0) * band
    return min(along * incidence, band)


@nb.njit(cache=True, parallel=True)
def integrate(
    blocks, range_image, cosine, slot_image, color_image, camera, max_step, max_weight,
    freespace_slot, rest_slot, observed, rotations, translations, voxel_sizes, truncations,
    block_coord, block_slot, distance, weight, color, belonging, has_surface, dirty,
):  # fmt: skip
    """Update every voxel of blocks (N,) that projects to a valid pixel and is not behind the truncation band.

    range_image (H, W) along the ray; cosine (H/2, W/2) between ray and surface: the distance along the ray times it is
    that along the surface's normal, which all views of a surface agree on (all ones: along the ray). slot_image (H, W):
    the submap slot of each pixel (-1: none; rest_slot: unlabeled), color_image (H, W, 3), camera (fx, fy, cx, cy).
    observed (slots,): objects with a segment in this frame. rotations, translations: T_camera_submap of each slot.
    distance (M, 8, 8, 8) int16, weight (M, 8, 8, 8) float32, color (M, 8, 8, 8, 3) and belonging (M, 8, 8, 8, 2)
    uint8, has_surface (M,) and dirty (M,) bool of the pool are written. Colour is kept within a voxel of the surface,
    where a mesh can need it.
    """
    height, width = range_image.shape
    zero = np.float32(0.0)
    right, bottom = np.float32(width - 1), np.float32(height - 1)
    focal_area = camera[0] * camera[1]
    for m in nb.prange(blocks.shape[0]):
        block = blocks[m]
        slot = block_slot[block]
        R, t = rotations[slot], translations[slot]
        size, band = voxel_sizes[slot], truncations[slot]
        scale, inv_scale = band / FULL, FULL / band
        area, drop = focal_area * size * size, np.float32(1.0) / (band - size)
        u, v = np.empty(SIDE * SIDE, dtype=np.float32), np.empty(SIDE * SIDE, dtype=np.float32)
        inverse, far = np.empty(SIDE * SIDE, dtype=np.float32), np.empty(SIDE * SIDE, dtype=np.float32)
        touched = False
        for i in range(SIDE):
            a = (np.float32(block_coord[block, 0] * SIDE + i) + np.float32(0.5)) * size
            project_slab(a, block_coord[block], R, t, size, camera, u, v, inverse, far)
            for n in range(SIDE * SIDE):
                inv_z = inverse[n]
                if not (u[n] >= zero and v[n] >= zero and u[n] <= right and v[n] <= bottom and inv_z > zero):
                    continue
                column, row = int(u[n] + np.float32(0.5)), int(v[n] + np.float32(0.5))
                sdf = signed_distance(range_image, cosine, u[n], v[n], column, row, far[n], band, max_step)
                if sdf < -band:
                    continue
                w = area * inv_z * inv_z * inv_z * inv_z
                if sdf < -size:
                    w *= (sdf + band) * drop
                j, k = n >> 3, n & 7
                W = weight[block, i, j, k]
                total = W + w
                if total <= zero:
                    continue
                touched = True
                gain = w / total
                in_band = sdf < band
                old = np.float32(distance[block, i, j, k]) * scale
                new = old + (sdf - old) * gain
                distance[block, i, j, k] = np.int16(np.rint(new * inv_scale))
                weight[block, i, j, k] = min(total, max_weight)
                if not in_band or slot == freespace_slot:
                    continue
                seen = slot_image[row, column]
                # A pixel without a label says nothing of whose surface it shows, but to the rest, and to an object of
                # which this frame has a segment that leaves the pixel out.
                unknown = (seen < 0 or (seen == rest_slot and slot != rest_slot)) and not observed[slot]
                if not unknown:
                    count_belonging(belonging[block, i, j, k], seen == slot)
                if (seen == slot or unknown) and sdf <= size and sdf >= -size:
                    mix_color(
                        color[block, i, j, k], color_image[row, column], max(gain, w / min(total, w * COLOR_MEMORY))
                    )
        if touched:
            dirty[block] = True
            one_voxel = np.int32(FULL * size / band)
            has_surface[block] = holds_surface(distance[block], weight[block], belonging[block], one_voxel)
