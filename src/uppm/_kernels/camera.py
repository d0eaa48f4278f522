"""What the kernels know of a frame: the range image, tiles of its depth, and the pixels of its segments."""

from __future__ import annotations

import numba as nb
import numpy as np

TILE = 16
"""Pixels along each side of a depth tile."""
PARTS = 8
"""Fixed, so that sums do not depend on the number of threads."""


@nb.njit(cache=True, parallel=True)
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


@nb.njit(inline="always")
def slope(depth, v, u, dv, du):
    """Change of depth a step (dv, du) from pixel (v, u): the flatter side's; huge where neither is valid."""
    d = depth[v, u]
    steep = np.float32(1e6)
    ahead, behind = steep, steep
    if 0 <= v + dv < depth.shape[0] and 0 <= u + du < depth.shape[1] and depth[v + dv, u + du] > np.float32(0.0):
        ahead = depth[v + dv, u + du] - d
    if 0 <= v - dv < depth.shape[0] and 0 <= u - du < depth.shape[1] and depth[v - dv, u - du] > np.float32(0.0):
        behind = d - depth[v - dv, u - du]
    return ahead if abs(ahead) < abs(behind) else behind


@nb.njit(cache=True, parallel=True)
def ray_cosine(depth, ray_x, ray_y, camera, least, out):
    """Cosine between each ray and the surface that it meets, at half the resolution, at least `least`.

    depth (H, W), the ray of pixel (v, u) is (ray_x[u], ray_y[v], 1), out (ceil(H/2), ceil(W/2)) written; pixels
    without depth or a neighbour get 1. With
    p = d * r, the normal is along (-fx * dd/du, -fy * dd/dv, d + a * fx * dd/du + b * fy * dd/dv), r = (a, b, 1).
    """
    fx, fy = camera[0], camera[1]
    one, reach = np.float32(1.0), 2
    for row in nb.prange(out.shape[0]):
        for column in range(out.shape[1]):
            v, u = 2 * row, 2 * column
            d = depth[v, u]
            out[row, column] = one
            if d <= np.float32(0.0):
                continue
            gu, gv = slope(depth, v, u, 0, reach), slope(depth, v, u, reach, 0)
            if abs(gu) > np.float32(1e5) or abs(gv) > np.float32(1e5):
                continue
            a, b = ray_x[u], ray_y[v]
            nx, ny = fx * gu / np.float32(reach), fy * gv / np.float32(reach)
            nz = d + a * nx + b * ny
            # The normal is (-nx, -ny, nz), and its product with the ray (a, b, 1) is d.
            cosine = d / np.sqrt((nx * nx + ny * ny + nz * nz) * (a * a + b * b + one))
            out[row, column] = max(least, min(one, cosine))


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
