"""Triangles into pixels with a z-buffer: which face each pixel shows, and what the face's corners say there.

Screen points are (u, v, nearness): pixel coordinates with integer pixel centres, and a number that grows towards the
eye and is linear on the screen (1/z of a perspective, -z of an orthographic view).
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

_BANDS = 32
"""Horizontal bands of the image, worked on in parallel."""


def rasterize(
    points: npt.NDArray[np.float64],
    faces: npt.NDArray[np.int32],
    values: npt.NDArray[np.float32],
    height: int,
    width: int,
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64], npt.NDArray[np.float32]]:
    """Nearest front face at each pixel.

    Parameters
    ----------
    points : (V, 3), on the screen.
    faces : (F, 3), counter-clockwise on the screen (v down) where they face the eye; the others are not drawn.
    values : (V, C), of the vertices.

    Returns
    -------
    face : (H, W) index of the face, -1 where there is none.
    nearness : (H, W), -inf where there is no face.
    pixels : (H, W, C) values, linear on the screen within a face; 0 where there is none.
    """
    face, nearness, pixels = _blank(height, width, values.shape[1])
    _rasterize(points, faces, values, face, nearness, pixels)
    return face, nearness, pixels


def _blank(height, width, channels):
    nearness = np.full((height, width), -np.inf)
    return np.full((height, width), -1, np.int32), nearness, np.zeros((height, width, channels), np.float32)


@numba.njit(inline="always")
def _edge(ax, ay, bx, by, x, y):
    """Twice the area of (a, b, (x, y)); positive where they run counter-clockwise on the screen."""
    return (by - ay) * (x - ax) - (bx - ax) * (y - ay)


@numba.njit(parallel=True, cache=True)
def _rasterize(points, faces, values, face, nearness, pixels):
    height = len(face)
    for band in numba.prange(_BANDS):
        top, bottom = band * height // _BANDS, (band + 1) * height // _BANDS
        for f in range(len(faces)):
            _draw(f, points, faces, face, nearness, top, bottom)
        for y in range(top, bottom):
            _interpolate(y, points, faces, values, face, pixels)


@numba.njit
def _draw(f, points, faces, face, nearness, top, bottom):
    ay, by, cy = points[faces[f, 0], 1], points[faces[f, 1], 1], points[faces[f, 2], 1]
    first, last = max(np.ceil(min(ay, by, cy)), float(top)), min(np.floor(max(ay, by, cy)), bottom - 1.0)
    if not first <= last:
        return
    a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
    area = _edge(a[0], ay, b[0], by, c[0], cy)
    if not area > 0:
        return
    left = int(max(np.ceil(min(a[0], b[0], c[0])), 0.0))
    right = int(min(np.floor(max(a[0], b[0], c[0])), face.shape[1] - 1.0))
    for y in range(int(first), int(last) + 1):
        for x in range(left, right + 1):
            wa = _edge(b[0], by, c[0], cy, x, y)
            wb = _edge(c[0], cy, a[0], ay, x, y)
            wc = _edge(a[0], ay, b[0], by, x, y)
            if wa >= 0 and wb >= 0 and wc >= 0:
                near = (wa * a[2] + wb * b[2] + wc * c[2]) / area
                if near > nearness[y, x]:
                    nearness[y, x], face[y, x] = near, f


@numba.njit
def _interpolate(y, points, faces, values, face, pixels):
    for x in range(face.shape[1]):
        f = face[y, x]
        if f < 0:
            continue
        ia, ib, ic = faces[f, 0], faces[f, 1], faces[f, 2]
        a, b, c = points[ia], points[ib], points[ic]
        area = _edge(a[0], a[1], b[0], b[1], c[0], c[1])
        wa = _edge(b[0], b[1], c[0], c[1], x, y) / area
        wb = _edge(c[0], c[1], a[0], a[1], x, y) / area
        for k in range(values.shape[1]):
            pixels[y, x, k] = wa * values[ia, k] + wb * values[ib, k] + (1 - wa - wb) * values[ic, k]


def rasterize_reference(
    points: npt.NDArray[np.float64],
    faces: npt.NDArray[np.int32],
    values: npt.NDArray[np.float32],
    height: int,
    width: int,
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64], npt.NDArray[np.float32]]:
    """`rasterize` in NumPy, a face at a time."""
    face, nearness, pixels = _blank(height, width, values.shape[1])
    v, u = np.mgrid[:height, :width].astype(np.float64)
    for f, (a, b, c) in enumerate(points[faces]):
        area = (b[1] - a[1]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[1] - a[1])
        if not area > 0:
            continue
        weights = _weights_reference(a, b, c, u, v)
        near = (weights * np.array([a[2], b[2], c[2]])).sum(axis=-1) / area
        shown = (weights >= 0).all(axis=-1) & (near > nearness)
        face[shown], nearness[shown] = f, near[shown]
        pixels[shown] = (weights[shown] / area) @ values[faces[f]]
    return face, nearness, pixels


def _weights_reference(a, b, c, u, v):
    """Unnormalised barycentric coordinates of pixels (..., 3)."""
    pairs = ((b, c), (c, a), (a, b))
    return np.stack([(q[1] - p[1]) * (u - p[0]) - (q[0] - p[0]) * (v - p[1]) for p, q in pairs], axis=-1)
