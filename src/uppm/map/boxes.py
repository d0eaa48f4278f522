"""Upright boxes around objects: vertical sides, turned as the object stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.geometry import level_axes


@dataclass(frozen=True, kw_only=True, eq=False)
class OrientedBox:
    """A box with a vertical axis around an object's surface, frame map."""

    center: npt.NDArray[np.float64]
    """(3,), metres."""
    size: npt.NDArray[np.float64]
    """(3,): along the longer and the shorter horizontal side, and up; metres."""
    R_map_box: npt.NDArray[np.float64]
    """(3, 3): columns are the directions of `size`."""

    @property
    def corners(self) -> npt.NDArray[np.float64]:
        """(8, 3), frame map."""
        signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        return self.center + signs * self.size @ self.R_map_box.T

    def to_dict(self) -> dict[str, Any]:
        """For programs: centre, size and axes, rounded to 0.1 mm."""
        return {
            "center": np.round(self.center, 4).tolist(),
            "size": np.round(self.size, 4).tolist(),
            "axes": np.round(self.R_map_box.T, 6).tolist(),
        }


def upright_box(points: npt.NDArray[np.floating], up: npt.NDArray[np.float64]) -> OrientedBox | None:
    """The upright box of least footprint around points (N, 3), frame map; None for fewer than three points."""
    if len(points) < 3:
        return None
    frame = np.stack([*level_axes(up), up]).astype(np.float64)
    local = points.astype(np.float64) @ frame.T
    (u, v), (w, h), degrees = cv2.minAreaRect(local[:, :2].astype(np.float32))
    low, high = local[:, 2].min(), local[:, 2].max()
    angle = np.deg2rad(degrees)
    first = np.array([np.cos(angle), np.sin(angle), 0.0])
    second = np.array([-np.sin(angle), np.cos(angle), 0.0])
    if h > w:
        first, second, w, h = second, -first, h, w
    axes = frame.T @ np.column_stack([first, second, np.array([0.0, 0.0, 1.0])])
    center = frame.T @ np.array([u, v, (low + high) / 2])
    return OrientedBox(center=center, size=np.array([w, h, high - low]), R_map_box=axes)
