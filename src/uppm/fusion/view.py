"""A frame prepared for the kernels: range image, depth tiles, rays, camera as single precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm._kernels.camera import TILE, prepare
from uppm.core.geometry import invert, rays
from uppm.core.types import Frame, Intrinsics

MIN_COSINE = np.float32(0.2)
"""Rays that meet a surface at less than 12 degrees are taken to meet it at that: noise makes their normals."""

RENDER_WIDTH = 160
"""Columns, about, at which submaps are rendered for association: at 320 the flat's map is the same."""

Camera = tuple[np.float32, np.float32, np.float32, np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """What one frame offers to the volume; images are (H, W) unless said."""

    depth: npt.NDArray[np.float32]
    """Metres along the optical axis; 0: invalid or out of range."""
    range_image: npt.NDArray[np.float32]
    """Metres along the ray; 0: as above."""
    ray_x: npt.NDArray[np.float32]
    """(W,): x of each column's rays at z = 1."""
    ray_y: npt.NDArray[np.float32]
    """(H,): y of each row's rays at z = 1."""
    cosine: npt.NDArray[np.float32]
    """(ceil(H/2), ceil(W/2)): cosine between ray and surface."""
    color: npt.NDArray[np.uint8]
    tile_min: npt.NDArray[np.float32]
    """(ceil(H/16), ceil(W/16))."""
    tile_max: npt.NDArray[np.float32]
    camera: Camera
    """fx, fy, cx, cy in pixels."""
    T_camera_map: npt.NDArray[np.float64]
    depth_max: np.float32

    @property
    def shape(self) -> tuple[int, int]:
        height, width = self.depth.shape
        return height, width

    @property
    def stride(self) -> int:
        """Pixels between those at which submaps are rendered and segments measured."""
        return max(1, round(self.shape[1] / RENDER_WIDTH))


class ViewFactory:
    """Makes views; keeps the rays of the camera seen last."""

    def __init__(self, depth_min: float, depth_max: float, *, along_normal: bool = True) -> None:
        self._along_normal = along_normal
        self._limits = np.float32(depth_min), np.float32(depth_max)
        self._intrinsics: Intrinsics | None = None
        self._ray_x, self._ray_y = np.empty(0, dtype=np.float32), np.empty(0, dtype=np.float32)
        self._ray_length = np.empty((0, 0), dtype=np.float32)

    def view(self, frame: Frame) -> View:
        """The frame with its depth limited to the configured range."""
        if frame.intrinsics != self._intrinsics:
            through = rays(frame.intrinsics)
            self._ray_x, self._ray_y = through[0, :, 0].copy(), through[:, 0, 1].copy()
            self._intrinsics, self._ray_length = frame.intrinsics, np.linalg.norm(through, axis=2)
        height, width = frame.depth.shape
        low, high = self._limits
        tiles = (-(-height // TILE), -(-width // TILE))
        depth, range_image = np.empty_like(frame.depth), np.empty_like(frame.depth)
        tile_min, tile_max = np.empty(tiles, dtype=np.float32), np.empty(tiles, dtype=np.float32)
        k = frame.intrinsics
        camera = np.float32(k.fx), np.float32(k.fy), np.float32(k.cx), np.float32(k.cy)
        cosine = np.ones((-(-height // 2), -(-width // 2)), dtype=np.float32)
        prepare(
            frame.depth, self._ray_length, low, high, self._ray_x, self._ray_y, camera, MIN_COSINE, self._along_normal,
            depth, range_image, tile_min, tile_max, cosine,
        )  # fmt: skip
        return View(
            depth=depth,
            range_image=range_image,
            cosine=cosine,
            ray_x=self._ray_x,
            ray_y=self._ray_y,
            color=frame.color,
            tile_min=tile_min,
            tile_max=tile_max,
            camera=camera,
            T_camera_map=invert(frame.T_map_camera),
            depth_max=high,
        )
