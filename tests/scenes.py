"""Analytic scenes: depth images of planes, spheres and boxes, exact to rounding."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from uppm.core.categories import category_by_name
from uppm.core.geometry import rays
from uppm.core.types import DescribedSegmentation, ElementaryDescriptor, Frame, Intrinsics, Provenance

CAMERA = Intrinsics(fx=150.0, fy=150.0, cx=79.5, cy=59.5, width=160, height=120)


def look_at(eye: npt.ArrayLike, target: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """T_map_camera (4, 4) of a camera at `eye` that looks at `target`, map z up."""
    eye, target = np.asarray(eye, dtype=np.float64), np.asarray(target, dtype=np.float64)
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = eye
    return pose


class Plane:
    """Points with normal . p = offset, frame map; seen from either side."""

    def __init__(self, normal: npt.ArrayLike, offset: float) -> None:
        self.normal, self.offset = np.asarray(normal, dtype=np.float64), offset

    def hit(self, origin: npt.NDArray, direction: npt.NDArray) -> npt.NDArray:
        """Ray parameter (N,), inf where missed."""
        along = direction @ self.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.offset - origin @ self.normal) / along
        return np.where((np.abs(along) > 1e-9) & (t > 0), t, np.inf)


class Sphere:
    def __init__(self, center: npt.ArrayLike, radius: float) -> None:
        self.center, self.radius = np.asarray(center, dtype=np.float64), radius

    def hit(self, origin: npt.NDArray, direction: npt.NDArray) -> npt.NDArray:
        """Ray parameter (N,), inf where missed."""
        a = (direction**2).sum(axis=1)
        b = direction @ (origin - self.center)
        c = ((origin - self.center) ** 2).sum() - self.radius**2
        root = b * b - a * c
        return np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


class Box:
    """An axis-aligned box between two corners."""

    def __init__(self, low: npt.ArrayLike, high: npt.ArrayLike) -> None:
        self.low, self.high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)

    def hit(self, origin: npt.NDArray, direction: npt.NDArray) -> npt.NDArray:
        """Ray parameter (N,), inf where missed."""
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (self.low - origin) / direction, (self.high - origin) / direction
        near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        return np.where((near <= far) & (near > 0), near, np.inf)


def render(shapes: list, pose: npt.NDArray, index: int = 0, camera: Intrinsics = CAMERA) -> tuple[Frame, npt.NDArray]:
    """A frame of the shapes and the id image (H, W): k for shapes[k - 1], 0 for nothing."""
    direction = rays(camera).reshape(-1, 3).astype(np.float64) @ pose[:3, :3].T
    hits = np.stack([shape.hit(pose[:3, 3], direction) for shape in shapes])
    nearest = hits.argmin(axis=0)
    depth = hits.min(axis=0)
    seen = np.isfinite(depth)
    ids = np.where(seen, nearest + 1, 0).astype(np.int32).reshape(camera.height, camera.width)
    color = np.zeros((camera.height, camera.width, 3), dtype=np.uint8)
    color[..., 0], color[..., 1] = ids * 60, 200 - ids * 60
    frame = Frame(
        index=index,
        stamp=float(index),
        color=color,
        depth=np.where(seen, depth, 0).astype(np.float32).reshape(ids.shape),
        T_map_camera=pose,
        intrinsics=camera,
    )
    return frame, ids


def described(ids: npt.NDArray[np.int32], names: list[tuple[str, str]], score: float = 1.0) -> DescribedSegmentation:
    """Segments of an id image, with (label, category) each; a stuff category is background."""
    categories = [category_by_name()[category] for _, category in names]
    return DescribedSegmentation(
        ids=ids,
        descriptors=tuple(
            ElementaryDescriptor(label=label, category=category, provenance=Provenance.GROUND_TRUTH, score=score)
            for (label, _), category in zip(names, categories, strict=True)
        ),
        is_thing=tuple(category.is_thing for category in categories),
    )
