"""Depth of one camera -> depth image of another, without resizing."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError

MAX_STEP = 0.05
"""Depths of a cell's corners that differ by a larger share belong to two surfaces."""

Depth = npt.NDArray[np.float32]
Matrix = npt.NDArray[np.float64]


def register_depth(
    depth: Depth, K_depth: Matrix, K_color: Matrix, T_color_depth: Matrix, size: tuple[int, int]
) -> Depth:
    """Depth image (H, W) in the colour camera of a depth image (h, w).

    The depth image is drawn as a surface (two triangles between four neighbours, cut where depth steps) into a
    z-buffer, so that a finer colour camera gets no holes and a plane stays one; then single pixels that no triangle
    reaches are drawn as points, so that no measurement is lost.

    Parameters
    ----------
    depth : (h, w) float32
        Metres; 0: invalid.
    K_depth, K_color : (3, 3)
        Camera matrices; integer pixel centres.
    T_color_depth : (4, 4)
        Depth camera to colour camera.
    size : (width, height)
        Of the colour image.
    """
    if not (np.isfinite(T_color_depth).all() and T_color_depth.shape == (4, 4)):
        found = "NaN or infinity" if T_color_depth.shape == (4, 4) else str(T_color_depth.shape)
        raise InputError("T_color_depth", expected="a finite (4, 4) pose", found=found, advice="check the extrinsics")
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    x, y = (u - K_depth[0, 2]) / K_depth[0, 0] * depth, (v - K_depth[1, 2]) / K_depth[1, 1] * depth
    points = np.stack([x, y, depth], axis=-1) @ T_color_depth[:3, :3].T + T_color_depth[:3, 3]
    z = np.where((depth > 0) & (points[..., 2] > 1e-3), points[..., 2], 0)
    safe = np.where(z > 0, z, 1)
    pu = K_color[0, 0] * points[..., 0] / safe + K_color[0, 2]
    pv = K_color[1, 1] * points[..., 1] / safe + K_color[1, 2]
    inverse = np.zeros((size[1], size[0]))
    _draw_surface(pu, pv, z, inverse)
    _draw_points(pu, pv, z, inverse)
    return np.divide(1, inverse, out=np.zeros_like(inverse), where=inverse > 0).astype(np.float32)


@numba.njit(cache=True)
def _draw_surface(u, v, z, inverse) -> None:  # type: ignore[no-untyped-def]
    height, width = z.shape
    for i in range(height - 1):
        for j in range(width - 1):
            _draw_triangle(u, v, z, (i, j), (i, j + 1), (i + 1, j), inverse)
            _draw_triangle(u, v, z, (i + 1, j + 1), (i + 1, j), (i, j + 1), inverse)


@numba.njit(cache=True)
def _draw_triangle(u, v, z, a, b, c, inverse) -> None:  # type: ignore[no-untyped-def]
    """Write 1/z, which is linear in the image over a plane, where it is the nearest yet."""
    near, far = min(z[a], z[b], z[c]), max(z[a], z[b], z[c])
    if near <= 0 or far - near > MAX_STEP * near:
        return
    abu, abv, acu, acv = u[b] - u[a], v[b] - v[a], u[c] - u[a], v[c] - v[a]
    area = abu * acv - abv * acu
    if abs(area) < 1e-12:
        return
    height, width = inverse.shape
    u0, u1 = max(np.ceil(min(u[a], u[b], u[c])), 0), min(np.floor(max(u[a], u[b], u[c])), width - 1)
    v0, v1 = max(np.ceil(min(v[a], v[b], v[c])), 0), min(np.floor(max(v[a], v[b], v[c])), height - 1)
    for row in range(int(v0), int(v1) + 1):
        for column in range(int(u0), int(u1) + 1):
            pu, pv = column - u[a], row - v[a]
            wb, wc = (pu * acv - pv * acu) / area, (abu * pv - abv * pu) / area
            if wb >= -1e-9 and wc >= -1e-9 and wb + wc <= 1 + 1e-9:
                value = (1 - wb - wc) / z[a] + wb / z[b] + wc / z[c]
                inverse[row, column] = max(inverse[row, column], value)


@numba.njit(cache=True)
def _draw_points(u, v, z, inverse) -> None:  # type: ignore[no-untyped-def]
    """Nearest pixel of each point, only where no surface is."""
    height, width = inverse.shape
    points = np.zeros_like(inverse)
    for i in range(z.shape[0]):
        for j in range(z.shape[1]):
            if z[i, j] > 0 and -0.5 <= u[i, j] < width - 0.5 and -0.5 <= v[i, j] < height - 0.5:
                row, column = int(v[i, j] + 0.5), int(u[i, j] + 0.5)
                points[row, column] = max(points[row, column], 1 / z[i, j])
    for row in range(height):
        for column in range(width):
            if inverse[row, column] == 0:
                inverse[row, column] = points[row, column]
