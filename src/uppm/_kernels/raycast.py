"""Rays through the surface cells of all submaps: where each first passes from free space into a surface, and whose.

A cell lies between eight voxel centres and is named after its lowest; within it the distance is trilinear. Only cells
that the surface passes through are kept, by block, each with the distances of its corners. A ray meets the blocks whose
footprint its tile is in, the nearest first, and walks through their cells (Amanatides and Woo 1987).
"""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.camera import TILE
from uppm._kernels.meshing import PATCH, SIDE, STEEP, crossing, fill_patch, owned
from uppm._kernels.sheets import EDGES

NONE = -1
ROUNDING = np.float32(1e-4)
"""Voxels by which a distance may be negative where a ray enters a cell: that of the cell before was not."""
SIDEWAYS = np.pi / 2 - 1e-6
"""Angle to the optical axis, radians, beyond which nothing is seen."""
STEPS = 4
"""Of false position: the distance along a ray in a cell is a cubic, and nearly straight."""


@nb.njit(cache=True)
def cell_corners(patch, around, belonging, i, j, k, values):
    """Distances in voxels at the corners (8,) of a cell of a block, written; returns which are the submap's own.

    That is a bit for each owned end of a crossed edge, and 0 where the cell is to be left out: an edge is crossed where
    a mesh would have it (`crossing`). Where the distance jumps along it, the farther end is moved to where a straight
    line has that crossing.
    """
    for c in range(8):
        values[c] = patch[i + 1 + (c & 1), j + 1 + (c >> 1 & 1), k + 1 + (c >> 2)]
    known, mine = values.copy(), 0
    for e in range(12):
        low, high, axis = EDGES[e, 0], EDGES[e, 1], e >> 2
        x, y, z = i + (low & 1), j + (low >> 1 & 1), k + (low >> 2)
        at = crossing(patch, x + 1, y + 1, z + 1, axis)
        if at < np.float32(0.0):
            continue
        ux, uy, uz = x + int(axis == 0), y + int(axis == 1), z + int(axis == 2)
        mine |= int(owned(around, x, y, z, belonging)) << low | int(owned(around, ux, uy, uz, belonging)) << high
        a, b = abs(known[low]), abs(known[high])
        if a + b > STEEP:
            near, far, share = (low, high, at) if a <= b else (high, low, np.float32(1.0) - at)
            size = min(abs(known[near]) * (np.float32(1.0) - share) / max(share, ROUNDING), abs(values[far]))
            values[far] = size if known[far] > np.float32(0.0) else -size
    return mine if mine and fill_corners(values, known) else 0


@nb.njit(cache=True)
def fill_corners(values, known):
    """Continue the distances (8,) of a cell to the corners where they are NaN; False where they do not reach one.

    From each corner beside it, by the mean slope of the cell's edges along that axis; known (8,): as observed.
    """
    for c in range(8):
        if not np.isnan(known[c]):
            continue
        total, count = np.float32(0.0), 0
        for axis in range(3):
            beside = c ^ (1 << axis)
            slope, edges = np.float32(0.0), 0
            for low in range(8):
                rise = known[low | 1 << axis] - known[low]
                if not low >> axis & 1 and not np.isnan(rise):
                    slope, edges = slope + rise, edges + 1
            if edges and not np.isnan(known[beside]):
                slope /= np.float32(edges)
                total += values[beside] + (slope if c >> axis & 1 else -slope)
                count += 1
        if count == 0:
            return False
        values[c] = total / np.float32(count)
    return True


@nb.njit(cache=True)
def cell_colors(around, i, j, k, color, belonging, out):
    """Colours (8, 3) of a cell's corners; the mean of the others where there is none, grey where none has one.

    Colour is kept near the surface only, where black stands for none; and what was never seen as the submap's has none.
    """
    mean, count = np.zeros(3, dtype=np.float32), 0
    out[:] = 0
    for c in range(8):
        x, y, z = i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)
        n = around[9 * (x >> 3) + 3 * (y >> 3) + (z >> 3) + 13]
        if n >= 0 and belonging[n, x & 7, y & 7, z & 7, 0] > 0:
            out[c] = color[n, x & 7, y & 7, z & 7]
        if out[c].any():
            count += 1
            for q in range(3):
                mean[q] += np.float32(out[c, q])
    for c in range(8):
        if not out[c].any():
            for q in range(3):
                out[c, q] = np.uint8(mean[q] / np.float32(count)) if count else np.uint8(128)


@nb.njit(cache=True, parallel=True)
def surface_cells(near, distance, weight, color, belonging, scale, table, counts, starts, corners, owners, colors):
    """The cells of a submap's blocks that its surface passes through.

    near (N, 27) as for `fill_patch`; scale: voxels a unit of `distance`. Written: table (N, 8, 8, 8), a cell's number
    within its block or NONE, and counts (N,). Written from starts (N,) on, unless corners is empty: corners (C, 8), the
    distances in voxels, corner c is the upper one along axis a where bit a of c is set; owners (C,), bit c is set where
    corner c is the submap's own; colors (C, 8, 3).
    """
    for n in nb.prange(near.shape[0]):
        patch, values = np.empty((PATCH, PATCH, PATCH), dtype=np.float32), np.empty(8, dtype=np.float32)
        fill_patch(near[n], distance, weight, scale, patch)
        count = 0
        for i in range(SIDE):
            for j in range(SIDE):
                for k in range(SIDE):
                    table[n, i, j, k] = NONE
                    mine = cell_corners(patch, near[n], belonging, i, j, k, values)
                    if mine == 0:
                        continue
                    table[n, i, j, k] = count
                    if corners.shape[0]:
                        corners[starts[n] + count], owners[starts[n] + count] = values, mine
                        cell_colors(near[n], i, j, k, color, belonging, colors[starts[n] + count])
                    count += 1
        counts[n] = count


@nb.njit(cache=True)
def spread(across, ahead, radius, focal, center, size):
    """First and last (exclusive) tile along one image axis, of so many pixels, in which a sphere may be seen.

    It is seen between the two planes through the eye that touch it and hold the other axis. Unlike the footprint of
    its bounding cube, that leaves out what stands beside the camera.
    """
    distance = np.hypot(across, ahead)
    if distance <= radius:
        return 0, (size + TILE - 1) // TILE
    middle, half = np.arctan2(across, ahead), np.arcsin(radius / distance)
    if middle - half >= SIDEWAYS or middle + half <= -SIDEWAYS:
        return 0, 0
    low = center + focal * np.tan(max(middle - half, -SIDEWAYS))
    high = center + focal * np.tan(min(middle + half, SIDEWAYS))
    first, last = min(max(np.ceil(low), 0.0), size), min(max(np.floor(high) + 1.0, 0.0), size)
    return int(first) // TILE, (int(last) + TILE - 1) // TILE


@nb.njit(cache=True)
def bin_blocks(order, centers, radii, camera, shape, boxes, tiles):
    """Add to tiles (T, T'): how many blocks each 16x16 tile may show.

    order (N,): block numbers. centers (B, 3) and radii (B,) of spheres around the blocks, frame camera, metres.
    boxes (B, 4), written: first and last (exclusive) tile across and down.
    """
    fx, fy, cx, cy = camera
    for n in order:
        x, y, z = centers[n]
        boxes[n, 0], boxes[n, 2] = spread(x, z, radii[n], fx, cx, shape[1])
        boxes[n, 1], boxes[n, 3] = spread(y, z, radii[n], fy, cy, shape[0])
        for ty in range(boxes[n, 1], boxes[n, 3]):
            for tx in range(boxes[n, 0], boxes[n, 2]):
                tiles[ty, tx] += 1


@nb.njit(cache=True)
def fill_tiles(order, boxes, starts, listed):
    """Write to listed the blocks of each tile in the given order, from starts (T, T') on, which moves to its end."""
    for n in order:
        for ty in range(boxes[n, 1], boxes[n, 3]):
            for tx in range(boxes[n, 0], boxes[n, 2]):
                listed[starts[ty, tx]] = n
                starts[ty, tx] += 1


@nb.njit(inline="always")
def trilinear(values, x, y, z):
    """Value at a place in a cell, 0 to 1 along each axis, of its corners (8,)."""
    low = (values[0] * (1 - x) + values[1] * x) * (1 - y) + (values[2] * (1 - x) + values[3] * x) * y
    high = (values[4] * (1 - x) + values[5] * x) * (1 - y) + (values[6] * (1 - x) + values[7] * x) * y
    return low * (1 - z) + high * z


@nb.njit(cache=True)
def enter(values, origin, direction, first, last):
    """Where a ray, from a cell's lowest corner, passes from positive to negative between two depths; -1: nowhere."""
    ox, oy, oz = origin
    dx, dy, dz = direction
    f = trilinear(values, ox + first * dx, oy + first * dy, oz + first * dz)
    g = trilinear(values, ox + last * dx, oy + last * dy, oz + last * dz)
    if f < -ROUNDING or g >= 0:
        return -1.0
    f = max(f, 0.0)
    for _ in range(STEPS):
        t = first + (last - first) * f / (f - g)
        h = trilinear(values, ox + t * dx, oy + t * dy, oz + t * dz)
        if h >= 0:
            first, f = t, h
        else:
            last, g = t, h
    return first + (last - first) * f / (f - g)


@nb.njit(cache=True)
def clip(low, high, origin, direction, span):
    """Narrow span (2,) to where a ray is within a box; False where it is not."""
    for q in range(3):
        if direction[q] == 0.0:
            if origin[q] < low[q] or origin[q] > high[q]:
                return False
            continue
        a, b = (low[q] - origin[q]) / direction[q], (high[q] - origin[q]) / direction[q]
        span[0], span[1] = max(span[0], min(a, b)), min(span[1], max(a, b))
    return span[0] < span[1]


@nb.njit(cache=True)
def walk(table, corners, low, high, origin, direction, span, cell, following):
    """Depth at which a ray enters the surface in one block's cells, and the cell's row in corners; -1 and NONE without.

    table (8, 8, 8): row in `corners` or NONE; low, high (3,): the block's cells, in voxels, as `origin`. cell (3,): the
    cell's place, written; following (3,): room for the depths at which the ray leaves the cell along each axis.
    """
    t = span[0]
    for q in range(3):
        cell[q] = min(max(int(np.floor(origin[q] + t * direction[q])), low[q]), high[q] - 1)
        edge = cell[q] + (1 if direction[q] > 0.0 else 0)
        following[q] = (edge - origin[q]) / direction[q] if direction[q] != 0.0 else np.inf
    while True:
        axis = 0 if following[0] <= following[1] else 1
        axis = axis if following[axis] <= following[2] else 2
        leave = min(following[axis], span[1])
        row = table[cell[0] & 7, cell[1] & 7, cell[2] & 7]
        if row != NONE:
            local = (origin[0] - cell[0], origin[1] - cell[1], origin[2] - cell[2])
            hit = enter(corners[row], local, direction, t, leave)
            if hit >= 0.0:
                return hit, row
        t = max(leave, t)
        forward = direction[axis] > 0.0
        cell[axis] += 1 if forward else -1
        if t >= span[1] or not low[axis] <= cell[axis] < high[axis]:
            return -1.0, NONE
        following[axis] = (cell[axis] + (1 if forward else 0) - origin[axis]) / direction[axis]


@nb.njit(cache=True, parallel=True)
def cast(
    starts, ends, listed, nearest, rows, tables, corners, owners, colors, low, high,
    rotations, origins, sizes, ray_x, ray_y, limits, depth, index, color,
):  # fmt: skip
    """First surface on each pixel's ray, over all submaps.

    A surface counts as farther by a voxel where none of it is the submap's own, and by less where some is: at the
    border of two submaps each surface goes on a little beyond its own part.

    listed: the blocks of each tile, from starts to ends (T, T'), sorted by nearest (B,), the least depth of a block's
    cells. rows (B,): a block's submap. tables (B, 8, 8, 8): each cell's row in corners (C, 8), owners (C,) and colors
    (C, 8, 3), or NONE. low, high (B, 3): box of a block's cells, in voxels from voxel (0, 0, 0)'s centre; rotations
    (S, 3, 3) and origins (S, 3) take camera axes and the camera's place there; sizes (S,): metres a voxel. limits:
    least and greatest depth, metres.
    Written where there is a surface: depth (H, W), metres along the optical axis; index (H, W), the submap's row;
    color (H, W, 3).
    """
    height, width = depth.shape
    for tile in nb.prange(starts.size):
        ty, tx = tile // starts.shape[1], tile % starts.shape[1]
        direction, span, following, cell = np.empty(3), np.empty(2), np.empty(3), np.empty(3, dtype=np.int64)
        for v in range(ty * TILE, min(height, (ty + 1) * TILE)):
            for u in range(tx * TILE, min(width, (tx + 1) * TILE)):
                best = limits[1]
                for m in range(starts[ty, tx], ends[ty, tx]):
                    b = listed[m]
                    if nearest[b] > best:
                        break
                    s = rows[b]
                    for q in range(3):
                        R = rotations[s, q]
                        direction[q] = R[0] * ray_x[u] + R[1] * ray_y[v] + R[2]
                    span[0], span[1] = limits[0], best
                    if not clip(low[b], high[b], origins[s], direction, span):
                        continue
                    hit, row = walk(tables[b], corners, low[b], high[b], origins[s], direction, span, cell, following)
                    if row == NONE:
                        continue
                    x = origins[s, 0] - cell[0] + hit * direction[0]
                    y = origins[s, 1] - cell[1] + hit * direction[1]
                    z = origins[s, 2] - cell[2] + hit * direction[2]
                    reach = hit + (1.0 - share(owners[row], x, y, z)) * sizes[s]
                    if reach < best:
                        best = reach
                        depth[v, u], index[v, u] = hit, s
                        paint(colors[row], x, y, z, color[v, u])


@nb.njit(inline="always")
def corner_weight(c, x, y, z):
    """Trilinear weight of a cell's corner at a place in it."""
    return (x if c & 1 else 1 - x) * (y if c & 2 else 1 - y) * (z if c & 4 else 1 - z)


@nb.njit(inline="always")
def share(owners, x, y, z):
    """How much of a place in a cell belongs to the submap, 0 to 1; owners: a bit for each corner that does."""
    total = 0.0
    for c in range(8):
        total += corner_weight(c, x, y, z) if owners >> c & 1 else 0.0
    return total


@nb.njit(inline="always")
def paint(corners, x, y, z, out):
    """Colour (3,) at a place in a cell of its corners' (8, 3)."""
    for q in range(3):
        value = 0.5
        for c in range(8):
            value += corner_weight(c, x, y, z) * corners[c, q]
        out[q] = np.uint8(value)
