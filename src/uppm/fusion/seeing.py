"""What depth images say of points: measured there, seen through, or neither (occluded, out of view)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from uppm._kernels.raster import rasterize
from uppm.core.geometry import invert, transform
from uppm.core.types import Frame, Intrinsics, Mesh

TOLERANCE = 0.03
"""Metres along the optical axis within which a depth is a point's own."""
NEAREST, FARTHEST = 0.1, 5.0
"""Metres: points out of this range are not judged."""
VIEWS, VIEW_WIDTH = 90, 320
"""Views rendered of a map, and their width in pixels."""
MARGIN = 32
"""Pixels out of the image at which a face's corner may still lie."""
AROUND = np.ones((3, 3), dtype=np.uint8)
"""Pixels that all must agree: poses and silhouettes are good to a pixel."""

Points = npt.NDArray[np.float64]
Pose = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sightings:
    """Frames, for each of N points."""

    measured: npt.NDArray[np.int64]
    """In which the depth is the point's."""
    through: npt.NDArray[np.int64]
    """In which the depth is beyond the point."""


def count_sightings(frames: Iterable[Frame], points: Sequence[Points]) -> list[Sightings]:
    """Sightings of each set of points (N, 3), frame map, by all frames."""
    if not len(points):
        return []
    joined = np.concatenate(list(points))
    measured, through = np.zeros(len(joined), dtype=np.int64), np.zeros(len(joined), dtype=np.int64)
    for frame in frames:
        z, inside, v, u = _project(joined, frame.T_map_camera, frame.intrinsics)
        near, far = cv2.erode(frame.depth, AROUND)[v, u], cv2.dilate(frame.depth, AROUND)[v, u]
        z = z[inside]
        # Invalid depth is 0: a point beside such a pixel is never seen through.
        through[inside] += near > z + TOLERANCE
        measured[inside] += (far > 0) & (near <= z + TOLERANCE) & (far >= z - TOLERANCE)
    ends = np.cumsum([len(p) for p in points])[:-1]
    pairs = zip(np.split(measured, ends), np.split(through, ends), strict=True)
    return [Sightings(measured=m, through=t) for m, t in pairs]


def _project(
    points: Points, pose: Pose, k: Intrinsics
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Depths of all points; indices, rows and columns of those in view and range."""
    p = transform(invert(pose), points)
    z = p[:, 2]
    ahead = np.flatnonzero((z > NEAREST) & (z < FARTHEST))
    u = np.rint(k.fx * p[ahead, 0] / z[ahead] + k.cx).astype(np.intp)
    v = np.rint(k.fy * p[ahead, 1] / z[ahead] + k.cy).astype(np.intp)
    kept = (u >= 0) & (v >= 0) & (u < k.width) & (v < k.height)
    return z, ahead[kept], v[kept], u[kept]


def rendered_views(mesh: Mesh, poses: Sequence[Pose], camera: Intrinsics, points: Points) -> Iterator[Frame]:
    """Depth that a camera at these T_map_camera sees of a mesh (frame map), either side of a face alike; no colour.

    Only from poses that have one of the points (N, 3) in view, and of these at most `VIEWS`.
    """
    scale = min(1.0, VIEW_WIDTH / camera.width)
    small = replace(
        camera,
        width=round(camera.width * scale),
        height=round(camera.height * scale),
        **{name: getattr(camera, name) * scale for name in ("fx", "fy", "cx", "cy")},
    )
    color = np.zeros((small.height, small.width, 3), dtype=np.uint8)
    looking = [pose for pose in poses if len(_project(points, pose, small)[1])]
    for n, pose in enumerate(looking[:: max(1, -(-len(looking) // VIEWS))]):
        yield Frame(
            index=n,
            stamp=float(n),
            color=color,
            depth=_rendered_depth(mesh, pose, small),
            T_map_camera=pose,
            intrinsics=small,
        )


def _rendered_depth(mesh: Mesh, pose: Pose, k: Intrinsics) -> npt.NDArray[np.float32]:
    p = transform(invert(pose), mesh.vertices)
    nearness = 1 / np.maximum(p[:, 2], NEAREST)
    u, v = k.fx * p[:, 0] * nearness + k.cx, k.fy * p[:, 1] * nearness + k.cy
    ahead, beside = p[:, 2] > NEAREST, (u < -MARGIN) | (v < -MARGIN) | (u > k.width + MARGIN) | (v > k.height + MARGIN)
    shown = mesh.faces[(ahead & ~beside)[mesh.faces].all(axis=1)]
    both_sides = np.concatenate([shown, shown[:, ::-1]])
    screen, nothing = np.stack([u, v, nearness], axis=1), np.empty((len(p), 0), dtype=np.float32)
    _, near, _ = rasterize(screen, both_sides, nothing, k.height, k.width)
    # Nothing is nearer than minus infinity, which is depth 0: never seen through.
    return np.where(near > 0, 1 / np.where(near > 0, near, 1.0), 0.0).astype(np.float32)
