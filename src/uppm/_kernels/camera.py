"""What the kernels know of a frame: the range image, tiles of its depth, and the pixels of its segments."""

from __future__ import annotations

import numba as nb
import numpy as np

TILE = 16
"""Pixels along each side of a depth tile."""
PARTS = 8
"""Fixed, so that sums do not depend on the number of threads."""


@nb.njit(cache=True, parallel=True, fastmath=True)
def prepare_depth(depth, ray_length, depth_min, depth_max, limited, range_image, tile_min, tile_max):
    """Depth within range (`limited`, else 0), range along the ray, and the tiles' least and greatest valid depth.

    depth, limited, range_image (H, W); ray_length (H, W): length of each pixel's ray at z = 1; tile_min and tile_max
    (ceil(H/16), ceil(W/16)): an empty tile has min 1e9 and max 0. All but the first two are written.
    """
    height, width = depth.shape
    zero = np.float32(0.0)
    for ty in nb.prange(tile_min.shape[0]):
        for tx in range(tile_min.shape[1]):
            low, high = np.float32(1e9), zero
            for y in range(ty * TILE, min(height, (ty + 1) * TILE)):
                for x in range(tx * TILE, min(width, (tx + 1) * TILE)):
                    d = depth[y, x]
                    valid = d >= depth_min and d <= depth_max
                    d = d if valid else zero
                    limited[y, x] = d
                    range_image[y, x] = d * ray_length[y, x]
                    low = min(low, d if valid else np.float32(1e9))
                    high = max(high, d)
            tile_min[ty, tx], tile_max[ty, tx] = low, high


@nb.njit(cache=True, parallel=True)
def segment_pixels(ids, depth, pixels, total):
    """Count the pixels with valid depth of each segment id, and sum their depth.

    ids, depth (H, W); pixels (PARTS, segments + 1) int64 and total (PARTS, segments + 1) float64 are added to.
    """
    height, width = ids.shape
    for part in nb.prange(PARTS):
        for y in range(part * height // PARTS, (part + 1) * height // PARTS):
            for x in range(width):
                d = depth[y, x]
                if d > 0:
                    pixels[part, ids[y, x]] += 1
                    total[part, ids[y, x]] += d


@nb.njit(cache=True, parallel=True)
def look_up(ids, table_a, table_b, out_a, out_b):
    """out_a = table_a[ids], out_b = table_b[ids], in one pass."""
    for y in nb.prange(ids.shape[0]):
        for x in range(ids.shape[1]):
            k = ids[y, x]
            out_a[y, x] = table_a[k]
            out_b[y, x] = table_b[k]


@nb.njit(cache=True)
def sphere_footprint(x, y, z, radius, camera, shape, out):
    """Pixel box (x0, y0, x1, y1; x1, y1 exclusive) that holds the projection of a sphere; False where out of view.

    Conservative: the box of the sphere's bounding cube, which is the whole image where it reaches behind the camera.
    """
    fx, fy, cx, cy = camera
    height, width = shape
    near, far = z - radius, z + radius
    if far <= 0.0:
        return False
    if near <= 0.05:
        out[0], out[1], out[2], out[3] = 0, 0, width, height
        return True
    left = (x - radius) / (near if x - radius < 0 else far)
    right = (x + radius) / (near if x + radius > 0 else far)
    top = (y - radius) / (near if y - radius < 0 else far)
    bottom = (y + radius) / (near if y + radius > 0 else far)
    out[0] = max(0, int(np.floor(fx * left + cx)))
    out[1] = max(0, int(np.floor(fy * top + cy)))
    out[2] = min(width, int(np.ceil(fx * right + cx)) + 1)
    out[3] = min(height, int(np.ceil(fy * bottom + cy)) + 1)
    return out[0] < out[2] and out[1] < out[3]
