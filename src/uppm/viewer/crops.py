"""The best views of each object, cut out of the sequence that a map was made of: a map keeps no pictures."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.errors import BadFrameError
from uppm.core.geometry import invert, project, transform
from uppm.core.protocols import FrameSource
from uppm.core.types import Frame, Intrinsics, Mesh

Pose = npt.NDArray[np.float64]

COUNT = 3
"""Views of an object."""
CANDIDATES = 8
"""Frames that are opened for each object: those in which most of it would be seen if nothing stood before it."""
MIN_GAP = 5
"""Frames between two views of an object, so that they are not the same twice."""
SAMPLES = 300
"""Vertices of an object that are looked for in each frame."""
NEAREST, SLACK, SLACK_SHARE = 0.1, 0.05, 0.02
"""A vertex is seen if it lies so far in front of the camera, and at the measured depth up to this and this share."""
MARGIN = 0.12
"""Around an object, as a share of its box."""
LARGEST_SIDE = 240
"""Pixels."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Crop:
    """An object in one frame."""

    frame: int
    share: float
    """Of the object's sampled surface that the frame shows, 0 to 1."""
    area: float
    """Pixels of its box."""
    image: npt.NDArray[np.uint8]
    """(H, W, 3), RGB, at most 240 pixels a side."""

    def jpeg(self) -> bytes:
        """The picture as a JPEG file."""
        bgr = np.ascontiguousarray(self.image[..., ::-1])
        return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()


def best_crops(
    meshes: Mapping[int, Mesh], path: Sequence[tuple[int, Pose]], source: FrameSource, *, count: int = COUNT
) -> dict[int, list[Crop]]:
    """The best views of each mesh, the best first; none for what no frame shows.

    Parameters
    ----------
    meshes : submap id -> surface, frame map.
    path : frame index and T_map_camera of the frames that were integrated, as `camera_path` gives it.
    source : the sequence of those frames; each frame is opened once at most.
    """
    positions = {index: position for position, index in enumerate(source.indices)}
    poses = {index: T for index, T in path if index in positions}
    points = {id_: _sampled(mesh) for id_, mesh in meshes.items() if len(mesh.vertices)}
    if not poses or not points:
        return {}
    wanted, camera = defaultdict[int, list[int]](list), _intrinsics(source)
    for id_, samples in points.items():
        for index in _candidates(samples, poses, camera):
            wanted[index].append(id_)
    found = defaultdict[int, dict[int, Crop]](dict)
    for index in sorted(wanted):
        try:
            frame = source.frame(positions[index])
        except BadFrameError:
            continue
        for id_ in wanted[index]:
            crop = _crop(frame, poses[index], points[id_])
            if crop:
                found[id_][index] = crop
    return {id_: _chosen(crops, count) for id_, crops in found.items()}


def _chosen(crops: Mapping[int, Crop], count: int) -> list[Crop]:
    best = _apart({index: _worth(crop.share, crop.area) for index, crop in crops.items()}, count)
    return [crops[index] for index in best]


def _intrinsics(source: FrameSource) -> Intrinsics:
    for position in range(len(source)):
        try:
            return source.frame(position).intrinsics
        except BadFrameError:
            continue
    raise BadFrameError(source.name, expected="a frame that can be used", found="none", advice="see `uppm check`")


def _sampled(mesh: Mesh) -> npt.NDArray[np.float64]:
    """Vertices and normals (N, 2, 3) spread over a mesh."""
    rows = np.linspace(0, len(mesh.vertices) - 1, min(SAMPLES, len(mesh.vertices))).astype(int)
    return np.stack([mesh.vertices[rows], mesh.normals[rows]], axis=1).astype(np.float64)


def _candidates(samples: npt.NDArray[np.float64], poses: Mapping[int, Pose], camera: Intrinsics) -> list[int]:
    """Frames that would show most of an object, and large, if it stood alone."""
    scores: dict[int, float] = {}
    for index, T_map_camera in poses.items():
        inside, pixels = _in_image(samples, T_map_camera, camera)
        if inside.any():
            scores[index] = _worth(float(inside.mean()), float(np.prod(np.ptp(pixels[inside], axis=0)) + 1))
    return _apart(scores, CANDIDATES)


def _in_image(
    samples: npt.NDArray[np.float64], T_map_camera: Pose, camera: Intrinsics
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float64]]:
    """Which samples face the camera and fall into the image, and their pixels (N, 2)."""
    at = transform(invert(T_map_camera), samples[:, 0])
    facing = np.einsum("nk,nk->n", samples[:, 1], T_map_camera[:3, 3] - samples[:, 0]) > 0
    ahead = at[:, 2] > NEAREST
    pixels = project(np.where(ahead[:, None], at, 1.0), camera)
    inside = (pixels > 0).all(axis=1) & (pixels < (camera.width - 1, camera.height - 1)).all(axis=1)
    return facing & ahead & inside, pixels


def _crop(frame: Frame, T_map_camera: Pose, samples: npt.NDArray[np.float64]) -> Crop | None:
    """What a frame shows of an object; None where something stands before it."""
    inside, pixels = _in_image(samples, T_map_camera, frame.intrinsics)
    depth = transform(invert(T_map_camera), samples[:, 0])[inside, 2]
    u, v = np.rint(pixels[inside]).astype(int).T
    seen = np.abs(frame.depth[v, u] - depth) < SLACK + SLACK_SHARE * depth
    if not seen.any():
        return None
    low, high = np.array([u[seen], v[seen]]).min(axis=1), np.array([u[seen], v[seen]]).max(axis=1)
    margin = np.ceil(MARGIN * (high - low)).astype(int) + 4
    x0, y0 = np.maximum(low - margin, 0)
    x1, y1 = np.minimum(high + margin + 1, (frame.intrinsics.width, frame.intrinsics.height))
    area, share = float((x1 - x0) * (y1 - y0)), float(seen.sum() / len(samples))
    return Crop(frame=frame.index, share=share, area=area, image=_small(frame.color[y0:y1, x0:x1]))


def _small(image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    scale = LARGEST_SIDE / max(image.shape[:2])
    if scale >= 1:
        return image.copy()
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _worth(share: float, area: float) -> float:
    """How good a view is: whole before large."""
    return share * area**0.25


def _apart(scores: Mapping[int, float], count: int) -> list[int]:
    """The frames of the highest scores, no two of them neighbours."""
    chosen: list[int] = []
    for index in sorted(scores, key=lambda index: (-scores[index], index)):
        if len(chosen) < count and all(abs(index - other) >= MIN_GAP for other in chosen):
            chosen.append(index)
    return chosen
