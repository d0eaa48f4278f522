"""What the kernels know of a frame: the range image, tiles of its depth, and where each submap stands."""

from __future__ import annotations

import numba as nb
import numpy as np

TILE = 16
"""Pixels along each side of a depth tile."""


@nb.njit(cache=True, parallel=True, fastmath=False)
def prepare_depth(depth, rays, depth_min, depth_max, range_image, tile_min, tile_max):
    """Range along the ray (0: invalid or out of range) and the tiles' least and greatest valid depth.

    depth (H, W), rays (H, W, 3) at z = 1; range_image (H, W), tile_min and tile_max (ceil(H/16), ceil(W/16)) are
    written; an empty tile has min inf and max 0.
    """
    height, width = depth.shape
    for ty in nb.prange(tile_min.shape[0]):
        for tx in range(tile_min.shape[1]):
            tile_min[ty, tx] = np.float32(np.inf)
            tile_max[ty, tx] = np.float32(0.0)
        for y in range(ty * TILE, min(height, (ty + 1) * TILE)):
            for x in range(width):
                d = depth[y, x]
                if not (d >= depth_min and d <= depth_max):
                    range_image[y, x] = np.float32(0.0)
                    continue
                a, b = rays[y, x, 0], rays[y, x, 1]
                range_image[y, x] = d * np.sqrt(a * a + b * b + np.float32(1.0))
                tx = x // TILE
                tile_min[ty, tx] = min(tile_min[ty, tx], d)
                tile_max[ty, tx] = max(tile_max[ty, tx], d)


@nb.njit(cache=True)
def sphere_footprint(x, y, z, radius, camera, shape, out):
    """Pixel box (x0, y0, x1, y1; x1, y1 exclusive) that holds the projection of a sphere; False where out of view.

    Conservative: the box of the sphere's bounding cube, which is the whole image where it reaches behind the camera.
    """
    fx, fy, cx, cy = camera
    height, width = shape
    if z + radius <= 0.0:
        return False
    near = z - radius
    if near <= 0.05:
        # The cube reaches the camera plane: only the four side planes can exclude it.
        out[0], out[1], out[2], out[3] = 0, 0, width, height
        return True
    far = z + radius
    left = (x - radius) / (near if x - radius < 0 else far)
    right = (x + radius) / (near if x + radius > 0 else far)
    top = (y - radius) / (near if y - radius < 0 else far)
    bottom = (y + radius) / (near if y + radius > 0 else far)
    out[0] = max(0, int(np.floor(fx * left + cx)))
    out[1] = max(0, int(np.floor(fy * top + cy)))
    out[2] = min(width, int(np.ceil(fx * right + cx)) + 1)
    out[3] = min(height, int(np.ceil(fy * bottom + cy)) + 1)
    return out[0] < out[2] and out[1] < out[3]
