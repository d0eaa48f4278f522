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
    """One row (W,) of `prepare`'s depth; low, high (W,): least and greatest valid depth of each column so far."""
    zero, far = np.float32(0.0), np.float32(1e9)
    for x in range(depth.shape[0]):
        d = depth[x]
        valid = (d >= depth_min) & (d <= depth_max)
        d = d if valid else zero
        limited[x], range_row[x] = d, d * ray_length[x]
        least = d if valid else far
        low[x] = least if least < low[x] else low[x]
        high[x] = d if d > high[x] else high[x]


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
    """One row (W,) of cosines; across, down (W,): slopes over REACH pixels."""
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


@nb.njit(cache=True)
def thin_row(depth, depth_min, depth_max, out):
    """Every second pixel of a row (W,), 0 where out of range."""
    for u in range(out.shape[0]):
        d = depth[2 * u]
        out[u] = d if (d >= depth_min) & (d <= depth_max) else np.float32(0.0)


@nb.njit(cache=True)
def cosine_row(row, depth, depth_min, depth_max, ray_x, ray_y, camera, least, rows, out):
    """One row (ceil(W/2),) of `prepare`'s cosine; rows (3, n + REACH): room for three rows with margins of zero."""
    n, half = out.shape[0], REACH // 2
    for k in range(3):
        v = 2 * row + (k - 1) * REACH
        if 0 <= v < depth.shape[0]:
            thin_row(depth[v], depth_min, depth_max, rows[k, half : half + n])
        else:
            rows[k] = np.float32(0.0)
    here, across, down = rows[1, half : half + n], np.empty(n, dtype=np.float32), np.empty(n, dtype=np.float32)
    slopes(rows[1, :n], here, rows[1, 2 * half :], across)
    slopes(rows[0, half : half + n], here, rows[2, half : half + n], down)
    cosines(here, across, down, ray_x, ray_y[2 * row], camera, least, out)


@nb.njit(cache=True, parallel=True)
def prepare(
    depth, ray_length, depth_min, depth_max, ray_x, ray_y, camera, least, normal,
    limited, range_image, tile_min, tile_max, cosine,
):  # fmt: skip
    """What the other kernels ask of a depth image (H, W), in one pass; all but the first nine are written.

    limited (H, W): depth within range, else 0; range_image (H, W): along the ray, with ray_length (H, W) that of each
    pixel's ray at z = 1. tile_min, tile_max (ceil(H/16), ceil(W/16)): a tile's least and greatest valid depth, 1e9 and
    0 without any. cosine (ceil(H/2), ceil(W/2)), if `normal`: between each second ray and the surface that it meets, at
    least `least`; 1 without depth or a neighbour. The ray of pixel (v, u) is r = (ray_x[u], ray_y[v], 1); with p = d r,
    the normal is along (-fx dd/du, -fy dd/dv, d + a fx dd/du + b fy dd/dv), r = (a, b, 1).
    """
    height, width = depth.shape
    thin_x = ray_x[::2].copy()
    for ty in nb.prange(tile_min.shape[0]):
        low, high = np.full(width, np.float32(1e9)), np.zeros(width, dtype=np.float32)
        for y in range(ty * TILE, min(height, (ty + 1) * TILE)):
            limit_row(depth[y], ray_length[y], depth_min, depth_max, limited[y], range_image[y], low, high)
        for tx in range(tile_min.shape[1]):
            tile_min[ty, tx] = low[tx * TILE : (tx + 1) * TILE].min()
            tile_max[ty, tx] = high[tx * TILE : (tx + 1) * TILE].max()
        if normal:
            rows = np.zeros((3, cosine.shape[1] + REACH), dtype=np.float32)
            for row in range(ty * TILE // 2, min(cosine.shape[0], (ty + 1) * TILE // 2)):
                cosine_row(row, depth, depth_min, depth_max, thin_x, ray_y, camera, least, rows, cosine[row])


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
