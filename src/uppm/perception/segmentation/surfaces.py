"""A frame's smooth surface patches: what masks and structure are both made of.

All is done on inverse depth w = 1 / z. A plane is affine in w over the image, so that second differences of w vanish on
planes of any slant, and the noise of structured-light and time-of-flight sensors is nearly constant in w.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.types import Frame

WORK_WIDTH = 320
"""Frames are reduced to about this width, pixels; finer detail comes back with the colour edges."""
MIN_STEP = 0.003

"""Least step that counts as an edge, metres."""
NOISE_FACTOR = 5.0
"""An edge stands out of the frame's own noise by so much."""
CREASE_COS = float(np.cos(np.radians(22)))
"""Normals on the two sides of a crease differ by more than this angle."""
NORMAL_WINDOW = 5
MIN_PATCH = 40
"""Smaller patches are noise and stay without one, reduced pixels."""
FILL_ROUNDS = 4
FILL_STEP = 0.004
"""A pixel joins a patch whose inverse depth differs by less, 1/m, or by what noise explains."""
SQRT6 = 6**0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Surfaces:
    """Surface patches of one frame at reduced size (h, w)."""

    scale: int
    """Full-size pixels a reduced pixel, along each axis."""
    points: npt.NDArray[np.float32]
    """(h, w, 3), frame camera, metres; 0: invalid."""
    normals: npt.NDArray[np.float32]
    """(h, w, 3), unit, towards the camera; 0: unknown."""
    patches: npt.NDArray[np.int32]
    """(h, w); 0: none, else 1 to `count`."""
    count: int
    sizes: npt.NDArray[np.int64]
    """(count + 1,), pixels of each patch; index 0: of none."""
    planes: npt.NDArray[np.float64]
    """(count + 1, 4): least-squares plane normal . p + offset = 0 of unit normal towards the camera, frame camera."""
    rms: npt.NDArray[np.float64]
    """(count + 1,): root mean square distance of a patch's points to its plane, metres."""
    noise: float
    """Standard deviation of the inverse depth, 1/m."""

    @property
    def depth(self) -> npt.NDArray[np.float32]:
        return self.points[..., 2]


@lru_cache(maxsize=1)
def surfaces(frame: Frame) -> Surfaces:
    """Patches of a frame; the last result is kept, since several stages ask for it."""
    scale = max(1, round(frame.intrinsics.width / WORK_WIDTH))
    depth = np.ascontiguousarray(frame.depth[::scale, ::scale])
    inverse = _inverse_depth(depth)
    noise, step = _step(inverse)
    gradient = _gradient(inverse, step)
    normals = _normals(frame, scale, inverse, gradient)
    smooth = ~step & ~_creases(normals) & (inverse > 0)
    patches, count = _components(smooth)
    patches = _fill(patches, inverse, max(FILL_STEP, 3 * noise))
    points = _points(frame, scale, depth)
    planes, rms = fit_planes(points, np.where(depth > 0, patches, 0), count)
    return Surfaces(
        scale=scale,
        points=points,
        normals=normals,
        patches=patches,
        count=count,
        sizes=np.bincount(patches.ravel(), minlength=count + 1),
        planes=planes,
        rms=rms,
        noise=noise,
    )


def depth_noise(frame: Frame) -> float:
    """Standard deviation of a frame's inverse depth, 1/m."""
    scale = max(1, round(frame.intrinsics.width / WORK_WIDTH))
    return _step(_inverse_depth(np.ascontiguousarray(frame.depth[::scale, ::scale])))[0]


def _inverse_depth(depth: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """1 / z with single-pixel holes closed from their neighbours; 0 where nothing is known."""
    inverse = np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)
    closed = cv2.dilate(inverse, np.ones((3, 3), np.uint8))
    return np.where(inverse > 0, inverse, closed)


def _step(inverse: npt.NDArray[np.float32]) -> tuple[float, npt.NDArray[np.bool_]]:
    """Noise of the inverse depth, and the pixels where it bends or jumps more than that explains."""
    bend = np.zeros_like(inverse)
    bend[:, 1:-1] = np.abs(inverse[:, :-2] + inverse[:, 2:] - 2 * inverse[:, 1:-1])
    np.maximum(bend[1:-1], np.abs(inverse[:-2] + inverse[2:] - 2 * inverse[1:-1]), out=bend[1:-1])
    valid = inverse > 0
    # The median of the larger of two half-normal values is 1.05 of one's deviation, itself sqrt(6) of the noise.
    noise = float(np.median(bend[valid])) / (1.05 * SQRT6) if valid.any() else 0.0
    return noise, bend > np.maximum(MIN_STEP * inverse**2, NOISE_FACTOR * SQRT6 * noise)


def _gradient(inverse: npt.NDArray[np.float32], step: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """(h, w, 2): mean slope of the inverse depth around each pixel, steps left out."""
    keep = (~step & (inverse > 0)).astype(np.float32)
    window = (NORMAL_WINDOW, NORMAL_WINDOW)
    share = cv2.boxFilter(keep, -1, window)
    slopes = []
    for dx, dy in ((1, 0), (0, 1)):
        slope = cv2.Sobel(inverse, cv2.CV_32F, dx, dy, ksize=1, scale=0.5)
        slopes.append(cv2.boxFilter(slope * keep, -1, window) / np.maximum(share, 1e-6))
    return np.stack(slopes, axis=-1)


def _pixel_grid(frame: Frame, scale: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Full-size pixel coordinates (1, w) and (h, 1), from the principal point."""
    k = frame.intrinsics
    u = np.arange(0, k.width, scale, dtype=np.float32)[None, :] - np.float32(k.cx)
    v = np.arange(0, k.height, scale, dtype=np.float32)[:, None] - np.float32(k.cy)
    return u, v


def _normals(
    frame: Frame, scale: int, inverse: npt.NDArray[np.float32], gradient: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """The plane w = w0 + gu (u - u0) + gv (v - v0) has the normal (fx gu, fy gv, w at the principal point)."""
    u, v = _pixel_grid(frame, scale)
    gu, gv = gradient[..., 0] / scale, gradient[..., 1] / scale
    normals = np.stack([frame.intrinsics.fx * gu, frame.intrinsics.fy * gv, inverse - gu * u - gv * v], axis=-1)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.where((inverse > 0)[..., None], -normals / np.maximum(length, 1e-9), 0).astype(np.float32)


def _points(frame: Frame, scale: int, depth: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    u, v = _pixel_grid(frame, scale)
    x, y = u / frame.intrinsics.fx * depth, v / frame.intrinsics.fy * depth
    return np.stack([x, y, depth], axis=-1).astype(np.float32)


def _creases(normals: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Pixels whose normals turn by more than the crease angle from one side to the other."""
    crease = np.zeros(normals.shape[:2], dtype=bool)
    crease[:, 2:-2] = np.einsum("hwc,hwc->hw", normals[:, :-4], normals[:, 4:]) < CREASE_COS
    crease[2:-2] |= np.einsum("hwc,hwc->hw", normals[:-4], normals[4:]) < CREASE_COS
    return crease


def _components(smooth: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int32], int]:
    """Connected smooth regions of at least MIN_PATCH pixels, numbered from 1, largest first."""
    total, ids, stats, _ = cv2.connectedComponentsWithStats(smooth.astype(np.uint8), connectivity=4)
    areas = stats[1:, cv2.CC_STAT_AREA]
    order = np.argsort(-areas, kind="stable")
    order = order[areas[order] >= MIN_PATCH]
    renumber = np.zeros(total, dtype=np.int32)
    renumber[order + 1] = np.arange(1, len(order) + 1)
    return np.take(renumber, np.asarray(ids, dtype=np.int64)), len(order)


def _fill(patches: npt.NDArray[np.int32], inverse: npt.NDArray[np.float32], limit: float) -> npt.NDArray[np.int32]:
    """Grow the patches over edge pixels, each taking the neighbour that is nearest in inverse depth."""
    filled = cv2.copyMakeBorder(patches, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    values = cv2.copyMakeBorder(inverse, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    inner = np.s_[1:-1, 1:-1]
    around = (np.s_[1:-1, 2:], np.s_[1:-1, :-2], np.s_[2:, 1:-1], np.s_[:-2, 1:-1])
    gaps = [np.abs(values[at] - inverse) for at in around]
    for _ in range(FILL_ROUNDS):
        empty, chosen = filled[inner] == 0, filled[inner].copy()
        nearest = np.where(inverse > 0, np.float32(limit), np.float32(0))
        for at, gap in zip(around, gaps, strict=True):
            takes = empty & (filled[at] > 0) & (gap < nearest)
            np.copyto(chosen, filled[at], where=takes)
            np.copyto(nearest, gap, where=takes)
        filled[inner] = chosen
    return np.ascontiguousarray(filled[inner], dtype=np.int32)


def fit_planes(
    points: npt.NDArray[np.float32], patches: npt.NDArray[np.int32], count: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Least-squares plane (count + 1, 4) of each patch's points, and the root mean square distance to it, metres."""
    seen = patches > 0
    ids, p = patches[seen], points[seen].astype(np.float64)
    n = np.maximum(np.bincount(ids, minlength=count + 1), 1)
    mean = np.stack([np.bincount(ids, p[:, k], count + 1) for k in range(3)], axis=1) / n[:, None]
    moments = np.empty((count + 1, 3, 3))
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        product = np.bincount(ids, p[:, i] * p[:, j], count + 1) / n - mean[:, i] * mean[:, j]
        moments[:, i, j] = moments[:, j, i] = product
    spread, axes = np.linalg.eigh(moments)
    normal = axes[:, :, 0]
    offset = -np.einsum("ij,ij->i", normal, mean)
    sign = np.where(offset < 0, -1.0, 1.0)
    planes = np.concatenate([normal, offset[:, None]], axis=1) * sign[:, None]
    return planes, np.sqrt(np.maximum(spread[:, 0], 0))
