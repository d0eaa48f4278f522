"""What of a whole scan the cameras saw: only that can be asked of a map of their frames (method.md section 7)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from uppm.core.geometry import invert, project, transform
from uppm.core.types import Frame
from uppm.evaluation.ground_truth import UNKNOWN, SurfaceTruth

DEPTH_MIN, DEPTH_MAX = 0.1, 5.0
"""Metres: the range of method.md section 4."""
TOLERANCE = 0.05
"""Metres that the measured depth may differ from a point's, for the point to be what was seen."""


def observe(
    truth: SurfaceTruth, frames: Iterable[Frame], *, depth_min: float = DEPTH_MIN, depth_max: float = DEPTH_MAX
) -> SurfaceTruth:
    """The points of a scan that some frame saw within range.

    Where the frames have instance images, points whose instance is unknown get that of the pixel in the frame that saw
    them from nearest, and instances the pixels that show them.
    """
    nearest = np.full(len(truth.points), np.inf)
    voted = np.zeros(len(truth.points), dtype=np.int32)
    pixels = Counter[int]()
    for frame in frames:
        index, depth, v, u = _seen(truth.points, frame, depth_min, depth_max)
        closer = depth < nearest[index]
        index, depth, v, u = index[closer], depth[closer], v[closer], u[closer]
        nearest[index] = depth
        if frame.truth is not None:
            voted[index] = frame.truth.instance[v, u]
            ids, counts = np.unique(frame.truth.instance, return_counts=True)
            pixels.update(dict(zip(ids.tolist(), counts.tolist(), strict=True)))
    voted[~np.isin(voted, list(truth.instances))] = UNKNOWN
    seen = np.isfinite(nearest)
    instance = np.where(truth.instance == UNKNOWN, voted, truth.instance)
    instances = truth.instances
    if pixels:
        instances = {n: replace(i, pixels=pixels[n]) for n, i in truth.instances.items()}
    return replace(truth, points=truth.points[seen], instance=instance[seen], instances=instances, is_observed=True)


def _seen(
    points: npt.NDArray[np.float64], frame: Frame, depth_min: float, depth_max: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float64], npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Points whose depth is what their pixel measured: index, depth in metres, and pixel row and column; (K,) each."""
    local = transform(invert(frame.T_map_camera), points)
    index = np.flatnonzero((local[:, 2] >= depth_min) & (local[:, 2] <= depth_max))
    u, v = np.rint(project(local[index], frame.intrinsics)).astype(np.intp).T
    inside = (u >= 0) & (v >= 0) & (u < frame.intrinsics.width) & (v < frame.intrinsics.height)
    index, u, v = index[inside], u[inside], v[inside]
    depth = local[index, 2]
    agrees = np.abs(frame.depth[v, u] - depth) <= TOLERANCE
    return index[agrees], depth[agrees], v[agrees], u[agrees]
