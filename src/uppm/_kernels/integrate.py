"""Projective TSDF integration of one frame into the visible blocks of every submap (method.md section 4)."""

from __future__ import annotations

import numba as nb
import numpy as np

SIDE = 8
VOXELS = SIDE**3
FULL = np.float32(32767.0)
"""Fixed point of the distance: +-truncation is +-32767."""
BEHIND = np.float32(2.0)
"""Truncation distances along the ray at which a surface, however it is met, hides what is behind it."""
MIN_Z = np.float32(0.05)
NO_SLOT = -2
"""A slot that no pixel has."""
SHELL, FADE = np.float32(0.5), np.float32(40.0)
"""Voxels behind a surface from which on a measurement says less, and how fast: weight / (1 + FADE * voxels^2)."""
COLOR_MEMORY = np.float32(31.0)
"""The colour is a mean over at most about so many frames: 8-bit means stop moving beyond."""


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
    d, w, pairs = distance.ravel(), weight.ravel(), belonging.ravel().view(np.uint16)
    found = False
    for n in range(VOXELS):
        near = (abs(np.int32(d[n])) <= limit) & (w[n] > np.float32(0.0))
        mine, foreign = pairs[n] & 255, pairs[n] >> 8
        found |= near & (mine > 0) & (mine >= foreign)
    return found


@nb.njit(cache=True)
def paint(near, pixel, gain, color_image, color, order):
    """Mix the pixels' colours into those of the voxels marked by near (512,); order (512,): room for their numbers."""
    pixels = color_image.reshape((-1, 3))
    count = 0
    for n in range(VOXELS):
        order[count] = n
        count += near[n]
    for i in range(count):
        n = np.uint32(order[i])
        mix_color(color[n], pixels[np.uint32(pixel[n])], max(gain[n], np.float32(1.0) / COLOR_MEMORY))


@nb.njit(cache=True, error_model="numpy")
def project_block(coord, R, t, size, camera, shape, inverse, far, right, down, corner, pixel, halved):
    """Project the 512 voxel centres of a block; all outputs (512,).

    inverse: 1 / z, 0 where a voxel is out of the image or behind the camera; far: distance from the camera; corner:
    index of the upper left of the four pixels around; right, down: how far from that pixel, 0 to 1; pixel, halved:
    index of the nearest pixel, and of its place in an image of half the size. One flat loop without branches, so that
    it is compiled to vector instructions.
    """
    fx, fy, cx, cy = camera
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    width, half_width = np.int32(shape[1]), np.int32((shape[1] + 1) // 2)
    last_u, last_v = np.float32(shape[1] - 1), np.float32(shape[0] - 1)
    last_x, last_y = np.int32(max(shape[1] - 2, 0)), np.int32(max(shape[0] - 2, 0))
    a0, b0, c0 = np.float32(coord[0] * SIDE), np.float32(coord[1] * SIDE), np.float32(coord[2] * SIDE)
    r00, r01, r02, t0 = R[0, 0], R[0, 1], R[0, 2], t[0]
    r10, r11, r12, t1 = R[1, 0], R[1, 1], R[1, 2], t[1]
    r20, r21, r22, t2 = R[2, 0], R[2, 1], R[2, 2], t[2]
    for m in range(VOXELS):
        n = np.int32(m)
        a = (a0 + np.float32(n >> 6) + half) * size
        b = (b0 + np.float32((n >> 3) & 7) + half) * size
        c = (c0 + np.float32(n & 7) + half) * size
        x = r00 * a + r01 * b + r02 * c + t0
        y = r10 * a + r11 * b + r12 * c + t1
        z = r20 * a + r21 * b + r22 * c + t2
        inv_z = one / (z if z > MIN_Z else MIN_Z)
        u, v = fx * x * inv_z + cx, fy * y * inv_z + cy
        inside = (u >= zero) & (v >= zero) & (u <= last_u) & (v <= last_v) & (z > MIN_Z)
        u, v = u if inside else zero, v if inside else zero
        x0, y0 = np.int32(u), np.int32(v)
        x0, y0 = x0 if x0 < last_x else last_x, y0 if y0 < last_y else last_y
        column, row = np.int32(u + half), np.int32(v + half)
        inverse[m] = inv_z if inside else zero
        far[m] = np.sqrt(x * x + y * y + z * z)
        right[m], down[m] = u - np.float32(x0), v - np.float32(y0)
        corner[m], pixel[m] = y0 * width + x0, row * width + column
        halved[m] = (row >> 1) * half_width + (column >> 1)


@nb.njit(cache=True, error_model="numpy")
def gather(range_image, cosine, corner, halved, four, incidence):
    """The four range pixels around each voxel's, (4, 512), and the cosine at its pixel (512,)."""
    pixels, cosines = range_image.ravel(), cosine.ravel()
    right, below = min(1, range_image.shape[1] - 1), min(1, range_image.shape[0] - 1) * range_image.shape[1]
    b_pixels, c_pixels, d_pixels = pixels[right:], pixels[below:], pixels[right + below :]
    a, b, c, d = four[0], four[1], four[2], four[3]
    for n in range(VOXELS):
        # Unsigned: no check for an index from the end.
        at = np.uint32(corner[n])
        a[n], b[n], c[n], d[n] = pixels[at], b_pixels[at], c_pixels[at], d_pixels[at]
        incidence[n] = cosines[np.uint32(halved[n])]


@nb.njit(cache=True, error_model="numpy")
def signed_distances(inverse, far, right, down, four, incidence, band, max_step, sdf):
    """Distance of each voxel in front of the measured surface, at most band; below -band where not to be updated.

    The range is bilinear, or the nearest pixel's across a step or beside a hole. Returns how many are to be updated.
    """
    zero, half = np.float32(0.0), np.float32(0.5)
    a4, b4, c4, d4 = four[0], four[1], four[2], four[3]
    live = 0
    for n in range(VOXELS):
        a, b, c, d = a4[n], b4[n], c4[n], d4[n]
        left_one, right_one = (c if down[n] >= half else a), (d if down[n] >= half else b)
        nearest = right_one if right[n] >= half else left_one
        ab_low, ab_high = (a if a < b else b), (b if a < b else a)
        cd_low, cd_high = (c if c < d else d), (d if c < d else c)
        low, high = (ab_low if ab_low < cd_low else cd_low), (cd_high if ab_high < cd_high else ab_high)
        top, bottom = a + (b - a) * right[n], c + (d - c) * right[n]
        smooth = (low > zero) & (high - low <= max_step)
        measured = top + (bottom - top) * down[n] if smooth else nearest
        along = measured - far[n]
        distance = along * incidence[n]
        distance = distance if distance < band else band
        hidden = (inverse[n] <= zero) | (nearest <= zero) | (along < -BEHIND * band) | (distance < -band)
        sdf[n] = np.float32(-2.0) * band if hidden else distance
        live += np.int32(0) if hidden else np.int32(1)
    return live


@nb.njit(cache=True, error_model="numpy")
def average(sdf, inverse, area, size, band, max_weight, noise_growth, distance, weight, gain):
    """Move the running means of a block's distances and weights; gain (512,) is the new one's share.

    area: fx * fy * size^2; noise_growth: power of z with which the depth's standard deviation grows, so that the
    weight is area / z^4 where it is 2 (method.md section 4), area / z^2 where 1, area where 0.
    """
    inv_size = np.float32(1.0) / size
    scale, inv_scale = band / FULL, FULL / band
    zero, one, tiny, drop = np.float32(0.0), np.float32(1.0), np.float32(1e-30), np.float32(1.0) / (band - size)
    for n in range(VOXELS):
        s = sdf[n]
        live = s >= -band
        squared = inverse[n] * inverse[n]
        w = area * (squared if noise_growth > 0 else one) * (squared if noise_growth > 1 else one)
        w = w * (s + band) * drop if s < -size else w
        w = w if live else zero
        # Deep behind one surface may be just behind another, the other side of a wall say, which knows better.
        behind = s * inv_size + SHELL
        behind = behind if behind < zero else zero
        w /= np.float32(1.0) + FADE * behind * behind
        total = weight[n] + w
        share = w / (total if total > tiny else tiny)
        old = np.float32(distance[n]) * scale
        new = np.rint((old + (s - old) * share) * inv_scale)
        distance[n] = np.int16(new if live else np.float32(distance[n]))
        weight[n] = total if total < max_weight else max_weight
        gain[n] = share


@nb.njit(cache=True)
def look_at_slots(pixel, slot_image, shown):
    """The slot of each voxel's pixel, (512,)."""
    slots = slot_image.ravel()
    for n in range(VOXELS):
        shown[n] = slots[np.uint32(pixel[n])]


@nb.njit(cache=True)
def count_belongings(sdf, shown, slot, rest_slot, observed, size, band, belonging, near):
    """Count whose surface the voxels of a block showed; near[n]: voxel n shows the submap's own colour.

    Voxels count up to one voxel behind the surface: deeper may be the other side of a wall, which is another's.
    belonging (512,): two 8-bit counters as one number, the foreign one times 256; halved together on overflow. A pixel
    without a label says nothing of whose surface it shows, but to the rest, and to an object of which this frame has a
    segment that leaves the pixel out.
    """
    silent = np.int32(NO_SLOT if observed else -1)
    silent_rest = np.int32(NO_SLOT if observed or slot == rest_slot else rest_slot)
    for n in range(VOXELS):
        s = sdf[n]
        inside = (s >= -size) & (s < band)
        own, unknown = shown[n] == slot, (shown[n] == silent) | (shown[n] == silent_rest)
        yes, no = inside & own, inside & (not own) & (not unknown)
        mine, foreign = np.int32(belonging[n] & 255), np.int32(belonging[n] >> 8)
        full = (yes & (mine == 255)) | (no & (foreign == 255))
        mine, foreign = (mine >> 1 if full else mine), (foreign >> 1 if full else foreign)
        belonging[n] = np.uint16((mine + yes) | ((foreign + no) << 8))
        near[n] = (s >= -size) & (s <= size) & (s < band) & (own | unknown)


@nb.njit(cache=True, parallel=True, error_model="numpy")
def integrate(
    blocks, range_image, cosine, slot_image, color_image, camera, max_step, max_weight, noise_growth,
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
    focal_area = camera[0] * camera[1]
    for m in nb.prange(blocks.shape[0]):
        room, index = np.empty((10, VOXELS), dtype=np.float32), np.empty((4, VOXELS), dtype=np.int32)
        near = np.empty(VOXELS, dtype=np.bool_)
        inverse, far, right, down, sdf, gain = room[4], room[5], room[6], room[7], room[8], room[9]
        incidence = gain
        block = blocks[m]
        slot = block_slot[block]
        size, band = voxel_sizes[slot], truncations[slot]
        project_block(
            block_coord[block], rotations[slot], translations[slot], size, camera, range_image.shape,
            inverse, far, right, down, index[0], index[1], index[2],
        )  # fmt: skip
        gather(range_image, cosine, index[0], index[2], room[:4], incidence)
        if signed_distances(inverse, far, right, down, room[:4], incidence, band, max_step, sdf) == 0:
            continue
        d, w = distance[block].reshape(VOXELS), weight[block].reshape(VOXELS)
        average(sdf, inverse, focal_area * size * size, size, band, max_weight, noise_growth, d, w, gain)
        dirty[block] = True
        if slot != freespace_slot:
            look_at_slots(index[1], slot_image, index[2])
            pairs = belonging[block].reshape(2 * VOXELS).view(np.uint16)
            count_belongings(sdf, index[2], slot, rest_slot, observed[slot], size, band, pairs, near)
            paint(near, index[1], gain, color_image, color[block].reshape((VOXELS, 3)), index[3])
        has_surface[block] = holds_surface(
            distance[block], weight[block], belonging[block], np.int32(FULL * size / band)
        )
