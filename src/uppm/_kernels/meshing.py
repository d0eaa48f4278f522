"""Dual marching cubes over voxel blocks: a vertex for each sheet of surface in a cell, a quad for each crossed edge.

A cell lies between eight voxel centres and is named after its lowest. Its vertex minimises the squared distances to the
tangent planes at the crossings of its edges (dual contouring, Ju et al. 2002), so that creases stay sharp where voxels
are coarse. Sheets of one cell have a vertex each, so that the mesh stays a manifold (Nielson 2004).
"""

from __future__ import annotations

import numba as nb
import numpy as np

from uppm._kernels.sheets import BITS, EDGES, SHEET, SHEETS

SIDE = 8
PATCH = SIDE + 3
"""Voxels along a block with one before it and two after it."""
STEEP = np.float32(1.3)
"""Voxels of distance between the ends of an edge; where more, an end is wrong."""
DEEP = np.float32(0.35)
"""Voxels; on a steep edge, how far its nearer end may be from a surface that no slope leads to."""
ALIKE = np.float32(0.2)
"""One-sided differences that agree so well are averaged."""
PULL = np.float32(0.02)
"""Weight that draws a vertex to the middle of its crossings, where each tangent plane has one."""
FILL = np.float32(0.5)
"""How far the middle moves to that of the cell where some crossings were not seen: the border lies beyond the last."""
SLACK = np.float32(0.1)
"""Voxels by which a vertex may leave its cell."""


@nb.njit(cache=True)
def fill_patch(near, distance, weight, scale, patch):
    """Distances in voxels around a block: patch[i, j, k] is voxel (i - 1, j - 1, k - 1), NaN where not observed.

    near (27,): the block at each offset (dx, dy, dz), at 9 * dx + 3 * dy + dz + 13, or -1.
    """
    for i in range(PATCH):
        x = i - 1
        for j in range(PATCH):
            y = j - 1
            for k in range(PATCH):
                z = k - 1
                b = near[9 * (x >> 3) + 3 * (y >> 3) + (z >> 3) + 13]
                if b >= 0 and weight[b, x & 7, y & 7, z & 7] > np.float32(0.0):
                    # Never 0, so that no quad degenerates.
                    patch[i, j, k] = (np.float32(distance[b, x & 7, y & 7, z & 7]) + np.float32(0.5)) * scale
                else:
                    patch[i, j, k] = np.nan


@nb.njit(cache=True)
def crossing(patch, x, y, z, axis):
    """Where the surface crosses the edge from a voxel upwards along an axis, 0 to 1; -1 where it is not known to.

    Distances change by at most a voxel a voxel. Where much more lies between the ends, rays passed beside the surface,
    which makes distances too great: the nearer end is right, and the slope that leads to it from beyond tells where the
    surface is. Where none does, the end is hidden behind another part of the surface, unless it is very near.
    """
    dx, dy, dz = int(axis == 0), int(axis == 1), int(axis == 2)
    low, high = patch[x, y, z], patch[x + dx, y + dy, z + dz]
    if np.isnan(low) or np.isnan(high) or (low < np.float32(0.0)) == (high < np.float32(0.0)):
        return np.float32(-1.0)
    a, b = abs(low), abs(high)
    if a + b <= STEEP:
        return a / (a + b)
    beyond = patch[x - dx, y - dy, z - dz] if a <= b else patch[x + 2 * dx, y + 2 * dy, z + 2 * dz]
    near = min(a, b)
    slope = (low - beyond if a <= b else beyond - high) * (np.float32(1.0) if high > low else np.float32(-1.0))
    # False where the voxel beyond was not observed.
    if slope > near:
        near = min(near / min(slope, np.float32(1.0)), np.float32(1.0))
    elif near > DEEP:
        return np.float32(-1.0)
    return near if a <= b else np.float32(1.0) - near


@nb.njit(cache=True)
def cell_sheets(patch, i, j, k):
    """Case of the cell whose lowest corner is patch[i, j, k], and which of its sheets were seen (a bit each).

    A corner that was not observed counts as inside: it is hidden behind the surface.
    """
    case = 0
    for corner in range(8):
        if not patch[i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)] >= np.float32(0.0):
            case |= 1 << corner
    seen = 0
    if case > 0 and case < 255:
        for e in range(12):
            if SHEET[case, e] >= 0:
                p = EDGES[e, 0]
                if crossing(patch, i + (p & 1), j + (p >> 1 & 1), k + (p >> 2), e >> 2) >= np.float32(0.0):
                    seen |= 1 << SHEET[case, e]
    return case, seen


@nb.njit(cache=True, parallel=True)
def find_cells(blocks, near, distance, weight, scale, cases, seen, counts):
    """Cases and seen sheets (N, 8, 8, 8) of the cells of some blocks (M,), and their number of vertices, counts (M,).

    near (N, 27) as for `fill_patch`; scale: voxels a unit of `distance`. The last three are written.
    """
    for m in nb.prange(blocks.shape[0]):
        n = blocks[m]
        patch = np.empty((PATCH, PATCH, PATCH), dtype=np.float32)
        fill_patch(near[n], distance, weight, scale, patch)
        total = 0
        for i in range(SIDE):
            for j in range(SIDE):
                for k in range(SIDE):
                    case, sheets = cell_sheets(patch, i + 1, j + 1, k + 1)
                    cases[n, i, j, k], seen[n, i, j, k] = case, sheets
                    total += BITS[sheets]
        counts[m] = total


@nb.njit(inline="always")
def differences(before, here, after):
    """The two one-sided differences along an axis; the same where they agree, or where one side is not known."""
    back, ahead = here - before, after - here
    no_back, no_ahead = np.isnan(back), np.isnan(ahead)
    if no_back or no_ahead:
        one = np.float32(0.0) if no_back and no_ahead else (ahead if no_back else back)
        return one, one
    if abs(back - ahead) < ALIKE:
        mean = np.float32(0.5) * (back + ahead)
        return mean, mean
    return back, ahead


@nb.njit(cache=True)
def tangent(patch, i, j, k, normal):
    """Unit normal (3,) at a voxel: of each axis' one-sided differences those whose gradient is nearest to length one.

    Across a crease one side's difference is another surface's. A distance's gradient has length one, a mixture's not.
    """
    d = patch[i, j, k]
    x0, x1 = differences(patch[i - 1, j, k], d, patch[i + 1, j, k])
    y0, y1 = differences(patch[i, j - 1, k], d, patch[i, j + 1, k])
    z0, z1 = differences(patch[i, j, k - 1], d, patch[i, j, k + 1])
    best = np.float32(1e9)
    for n in range(8):
        x, y, z = x1 if n & 1 else x0, y1 if n & 2 else y0, z1 if n & 4 else z0
        off = abs(x * x + y * y + z * z - np.float32(1.0))
        if off < best:
            best = off
            normal[0], normal[1], normal[2] = x, y, z
    normalize(normal)


@nb.njit(inline="always")
def normalize(v):
    """Scale a vector (3,) to length one; none stays none."""
    inverse = np.float32(1.0) / max(np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]), np.float32(1e-6))
    for q in range(3):
        v[q] *= inverse


@nb.njit(cache=True)
def sheet_crossings(patch, i, j, k, case, sheet, points, normals, middle):
    """Crossings of one sheet of a cell, in voxels from its lowest corner, and their unit normals; returns how many.

    points, normals (12, 3) and middle (3,), the vertex's place as far as tangent planes leave it open, are written.
    """
    count, whole = 0, True
    middle[:] = np.float32(0.0)
    for e in range(12):
        if SHEET[case, e] != sheet:
            continue
        p, axis = EDGES[e, 0], e >> 2
        x, y, z = i + (p & 1), j + (p >> 1 & 1), k + (p >> 2)
        at = crossing(patch, x, y, z, axis)
        if at < np.float32(0.0):
            whole = False
            continue
        points[count, 0], points[count, 1], points[count, 2] = p & 1, p >> 1 & 1, p >> 2
        points[count, axis] = at
        ux, uy, uz = x + int(axis == 0), y + int(axis == 1), z + int(axis == 2)
        if abs(patch[ux, uy, uz]) < abs(patch[x, y, z]):
            x, y, z = ux, uy, uz
        tangent(patch, x, y, z, normals[count])
        for q in range(3):
            middle[q] += points[count, q]
        count += 1
    for q in range(3):
        middle[q] /= np.float32(count)
        if not whole:
            middle[q] += FILL * (np.float32(0.5) - middle[q])
    return count


@nb.njit(cache=True)
def fit(points, normals, count, vertex, normal):
    """Vertex (3,), which holds the middle, to where it is closest to the tangent planes; normal (3,) their mean."""
    A, b = np.zeros((3, 3), dtype=np.float32), np.zeros(3, dtype=np.float32)
    normal[:] = np.float32(0.0)
    for q in range(3):
        A[q, q] = PULL * np.float32(count)
    for n in range(count):
        off = np.float32(0.0)
        for q in range(3):
            off += normals[n, q] * (points[n, q] - vertex[q])
        for q in range(3):
            b[q] += normals[n, q] * off
            normal[q] += normals[n, q]
            for r in range(3):
                A[q, r] += normals[n, q] * normals[n, r]
    # Cramer's rule: A is symmetric and positive definite.
    x, y, z = (
        A[1, 1] * A[2, 2] - A[1, 2] * A[1, 2],
        A[1, 2] * A[0, 2] - A[0, 1] * A[2, 2],
        A[0, 1] * A[1, 2] - A[1, 1] * A[0, 2],
    )
    u, v, w = (
        A[0, 0] * A[2, 2] - A[0, 2] * A[0, 2],
        A[0, 1] * A[0, 2] - A[0, 0] * A[1, 2],
        A[0, 0] * A[1, 1] - A[0, 1] * A[0, 1],
    )
    scale = np.float32(1.0) / (A[0, 0] * x + A[0, 1] * y + A[0, 2] * z)
    vertex[0] += (x * b[0] + y * b[1] + z * b[2]) * scale
    vertex[1] += (y * b[0] + u * b[1] + v * b[2]) * scale
    vertex[2] += (z * b[0] + v * b[1] + w * b[2]) * scale
    for q in range(3):
        vertex[q] = min(max(vertex[q], -SLACK), np.float32(1.0) + SLACK)
    normalize(normal)


@nb.njit(cache=True)
def sheet_color(near, i, j, k, case, sheet, color, belonging, out):
    """Mean colour (3,) of the ends of one sheet's edges that have one, NaN without any.

    Colour is kept near the surface only, where black stands for none; and what was never seen as the submap's has none.
    """
    weight = np.float32(0.0)
    out[:] = np.float32(0.0)
    for e in range(12):
        if SHEET[case, e] != sheet:
            continue
        for end in range(2):
            c = EDGES[e, end]
            x, y, z = i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)
            n = near[9 * (x >> 3) + 3 * (y >> 3) + (z >> 3) + 13]
            if n < 0 or belonging[n, x & 7, y & 7, z & 7, 0] == 0:
                continue
            seen = color[n, x & 7, y & 7, z & 7]
            if seen[0] > 0 or seen[1] > 0 or seen[2] > 0:
                for q in range(3):
                    out[q] += np.float32(seen[q])
                weight += np.float32(1.0)
    for q in range(3):
        out[q] = out[q] / weight if weight > np.float32(0.0) else np.float32(np.nan)


@nb.njit(cache=True, parallel=True)
def make_vertices(
    blocks, near, coords, distance, weight, color, belonging, scale, cases, seen, starts,
    first, vertices, normals, colors,
):  # fmt: skip
    """Vertices, in voxels of frame submap from voxel (0, 0, 0)'s centre, unit normals and colours, NaN for none.

    starts (M,): first vertex of each of the blocks (M,); first (N, 8, 8, 8): each cell's first within its block; the
    last three (V, 3). The last four are written.
    """
    for m in nb.prange(blocks.shape[0]):
        n, at = blocks[m], starts[m]
        patch = np.empty((PATCH, PATCH, PATCH), dtype=np.float32)
        points, tangents = np.empty((12, 3), dtype=np.float32), np.empty((12, 3), dtype=np.float32)
        fill_patch(near[n], distance, weight, scale, patch)
        for i in range(SIDE):
            for j in range(SIDE):
                for k in range(SIDE):
                    case = cases[n, i, j, k]
                    first[n, i, j, k] = at - starts[m]
                    for sheet in range(SHEETS[case]):
                        if not seen[n, i, j, k] >> sheet & 1:
                            continue
                        vertex = vertices[at]
                        count = sheet_crossings(patch, i + 1, j + 1, k + 1, case, sheet, points, tangents, vertex)
                        fit(points, tangents, count, vertex, normals[at])
                        for q in range(3):
                            vertex[q] += np.float32(coords[n, q] * SIDE + (i, j, k)[q])
                        sheet_color(near[n], i, j, k, case, sheet, color, belonging, colors[at])
                        at += 1


@nb.njit(inline="always")
def owned(near, x, y, z, belonging):
    """Whether a voxel near a block belongs to the submap."""
    counts = belonging[near[9 * (x >> 3) + 3 * (y >> 3) + (z >> 3) + 13], x & 7, y & 7, z & 7]
    return counts[0] > 0 and counts[0] >= counts[1]


@nb.njit(cache=True)
def quad(near, x, y, z, axis, cases, seen, first, out):
    """Corners of the quad of an edge, counter-clockwise seen from above it; False where a cell's block is not there.

    out (4, 2): place of a corner's block in `near`, and its vertex within that block; written.
    """
    for turn in range(4):
        # (0, 0), (1, 0), (1, 1), (0, 1): the cells around the edge, below it along the next two axes.
        b, c = int(turn == 1 or turn == 2), int(turn >= 2)
        i = x - (b if axis == 2 else 0) - (c if axis == 1 else 0)
        j = y - (b if axis == 0 else 0) - (c if axis == 2 else 0)
        k = z - (b if axis == 1 else 0) - (c if axis == 0 else 0)
        place = 9 * (i >> 3) + 3 * (j >> 3) + (k >> 3) + 13
        n = near[place]
        if n < 0:
            return False
        sheet = SHEET[cases[n, i & 7, j & 7, k & 7], 4 * axis + 2 * b + c]
        before = BITS[seen[n, i & 7, j & 7, k & 7] & ((1 << sheet) - 1)]
        out[turn, 0], out[turn, 1] = place, first[n, i & 7, j & 7, k & 7] + before
    return True


@nb.njit(cache=True, parallel=True)
def make_quads(blocks, near, distance, weight, belonging, scale, cases, seen, first, counts, starts, out):
    """Quads of the edges that leave the voxels of some blocks (M,) upwards and have an end that belongs to the submap.

    counts (M,): their number, written. out (Q, 4, 2) as for `quad`, counter-clockwise seen from free space, written
    from starts (M,) on; where out is empty the quads are counted only.
    """
    for m in nb.prange(blocks.shape[0]):
        around, count = near[blocks[m]], 0
        corners = np.empty((4, 2), dtype=np.int32)
        patch = np.empty((PATCH, PATCH, PATCH), dtype=np.float32)
        fill_patch(around, distance, weight, scale, patch)
        for i in range(SIDE):
            for j in range(SIDE):
                for k in range(SIDE):
                    for axis in range(3):
                        if crossing(patch, i + 1, j + 1, k + 1, axis) < np.float32(0.0):
                            continue
                        x, y, z = i + int(axis == 0), j + int(axis == 1), k + int(axis == 2)
                        if not (owned(around, i, j, k, belonging) or owned(around, x, y, z, belonging)):
                            continue
                        if not quad(around, i, j, k, axis, cases, seen, first, corners):
                            continue
                        if out.shape[0] > 0:
                            inside = patch[i + 1, j + 1, k + 1] < np.float32(0.0)
                            for turn in range(4):
                                out[starts[m] + count, turn if inside else 3 - turn] = corners[turn]
                        count += 1
        counts[m] = count
