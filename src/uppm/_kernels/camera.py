"""What the kernels know of a frame: the range image, tiles of its depth, and how its rays meet surfaces."""

from __future__ import annotations

import numba as nb
import numpy as np

TILE = 16
"""Pixels along each side of a depth tile."""
PARTS = 8
"""Fixed, so that sums do not depend on the number of threads."""
REACH = 2
"""Pixels between those whose depths give a slope; even."""
STEEP = np.float32(1e6)


@nb.njit(cache=True)
def limit_row(depth, ray_length, depth_min, depth_max, limited, range_row, low, high):
    """One row (W,) of `prepare_depth`; low, high (W,): least and greatest valid depth of each column so far."""
    zero, far = np.float32(0.0), np.float32(1e9)
    for x in range(depth.shape[0]):
        d = depth[x]
        valid = (d >= depth_min) & (d <= depth_max)
        d = d if valid else zero
        limited[x], range_row[x] = d, d * ray_length[x]
        least = d if valid else far
        low[x] = least if least < low[x] else low[x]
        high[x] = d if d > high[x] else high[x]


@nb.njit(cache=True, parallel=True)
def prepare_depth(depth, ray_length, depth_min, depth_max, limited, range_image, tile_min, tile_max):
    """Depth within range (`limited`, else 0), range along the ray, and the tiles' least and greatest valid depth.

    depth, limited, range_image (H, W); ray_length (H, W): length of each pixel's ray at z = 1; tile_min and tile_max
    (ceil(H/16), ceil(W/16)): an empty tile has min 1e9 and max 0. All but the first two are written.
    """
    height, width = depth.shape
    for ty in nb.prange(tile_min.shape[0]):
        low, high = np.full(width, np.float32(1e9)), np.zeros(width, dtype=np.float32)
        for y in range(ty * TILE, min(height, (ty + 1) * TILE)):
            limit_row(depth[y], ray_length[y], depth_min, depth_max, limited[y], range_image[y], low, high)
        for tx in range(tile_min.shape[1]):
            tile_min[ty, tx] = low[tx * TILE : (tx + 1) * TILE].min()
            tile_max[ty, tx] = high[tx * TILE : (tx + 1) * TILE].max()


@nb.njit(cache=True)
def slopes(before, here, after, out):
    """Change of depth from each pixel of a row (W,) to the next: the flatter side's; STEEP where neither is valid.

    before, after (W,): the depth of the pixels on its two sides.
    """
    zero = np.float32(0.0)
    for u in range(here.shape[0]):
        ahead = after[u] - here[u] if after[u] > zero else STEEP
        behind = here[u] - before[u] if before[u] > zero else STEEP
        out[u] = ahead if abs(ahead) < abs(behind) else behind


@nb.njit(cache=True, error_model="numpy")
def cosines(depth, across, down, ray_x, b, camera, least, out):
    """One row (W,) of `ray_cosine`; across, down (W,): slopes over REACH pixels."""
    one, reach = np.float32(1.0), np.float32(REACH)
    fx, fy = camera[0] / reach, camera[1] / reach
    for u in range(depth.shape[0]):
        a, d = ray_x[u], depth[u]
        nx, ny = fx * across[u], fy * down[u]
        nz = d + a * nx + b * ny
        # The normal is (-nx, -ny, nz), and its product with the ray (a, b, 1) is d.
        cosine = d / np.sqrt((nx * nx + ny * ny + nz * nz) * (a * a + b * b + one))
        cosine = cosine if cosine < one else one
        cosine = cosine if cosine > least else least
        known = (d > np.float32(0.0)) & (abs(across[u]) < STEEP) & (abs(down[u]) < STEEP)
        out[u] = cosine if known else one


@nb.njit(cache=True, parallel=True)
def ray_cosine(depth, ray_x, ray_y, camera, least, out):
    """Cosine between each ray and the surface that it meets, at half the resolution, at least `least`.

    depth (H, W), the ray of pixel (v, u) is (ray_x[u], ray_y[v], 1), out (ceil(H/2), ceil(W/2)) written; pixels
    without depth or a neighbour get 1. With
    p = d * r, the normal is along (-fx * dd/du, -fy * dd/dv, d + a * fx * dd/du + b * fy * dd/dv), r = (a, b, 1).
    """
    n, half = out.shape[1], REACH // 2
    columns = ray_x[::2].copy()
    for part in nb.prange(PARTS):
        # Every second pixel of three rows, with a margin that counts as without depth.
        rows = np.zeros((3, n + 2 * half), dtype=np.float32)
        across, down = np.empty(n, dtype=np.float32), np.empty(n, dtype=np.float32)
        for row in range(part * out.shape[0] // PARTS, (part + 1) * out.shape[0] // PARTS):
            for k in range(3):
                v = 2 * row + (k - 1) * REACH
                if 0 <= v < depth.shape[0]:
                    rows[k, half : half + n] = depth[v, ::2]
                else:
                    rows[k] = np.float32(0.0)
            here = rows[1, half : half + n]
            slopes(rows[1, :n], here, rows[1, 2 * half :], across)
            slopes(rows[0, half : half + n], here, rows[2, half : half + n], down)
            cosines(here, across, down, columns, ray_y[2 * row], camera, least, out[row])


@nb.njit(cache=True, parallel=True)
def look_up(ids, table_a, table_b, out_a, out_b):
    """out_a = table_a[ids], out_b = table_b[ids], in one pass."""
    for y in nb.prange(ids.shape[0]):
        for x in range(ids.shape[1]):
            k = np.uint32(ids[y, x])
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
