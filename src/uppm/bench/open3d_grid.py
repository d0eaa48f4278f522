"""Open3D's VoxelBlockGrid on the CPU: the yardstick, geometry only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from uppm.bench.timing import Clock
from uppm.core.errors import MissingExtraError
from uppm.core.geometry import invert
from uppm.core.types import Frame

COMMAND = "pip install uppm[bench]"
SYSTEM_COMMAND = "apt install libusb-1.0-0 libgl1 libgomp1, or what your system calls these"
RESOLUTIONS = (8, 16)
CAPACITY = {8: 50_000, 16: 8_000}
"""Blocks to begin with; the grid grows beyond."""


def load_open3d() -> Any:
    """The module; raises `MissingExtraError` where it, or a library of the system that it needs, is missing."""
    try:
        import open3d  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        if error.name == "open3d":
            raise MissingExtraError("Open3D", COMMAND) from None
        raise MissingExtraError(f"a library that Open3D loads ({error})", SYSTEM_COMMAND) from None
    return open3d


class Open3dGrid:
    """A VoxelBlockGrid that frames are integrated into; distance and weight, no colour.

    Parameters
    ----------
    voxel_size : float
        Metres.
    truncation : float
        Voxels.
    depth_max : float
        Metres.
    resolution : int
        Voxels along each side of a block.
    """

    def __init__(self, open3d: Any, voxel_size: float, truncation: float, depth_max: float, resolution: int) -> None:
        self._o3d, self.resolution = open3d, resolution
        # Depth in metres: a scale of one.
        self._range = 1.0, depth_max, truncation
        float32 = open3d.core.float32
        self._grid = open3d.t.geometry.VoxelBlockGrid(
            attr_names=("tsdf", "weight"),
            attr_dtypes=(float32, float32),
            attr_channels=((1), (1)),
            voxel_size=voxel_size,
            block_resolution=resolution,
            block_count=CAPACITY[resolution],
            device=open3d.core.Device("CPU:0"),
        )
        self.clock = Clock()
        """Block lookup and integration; not the conversion of the frame."""
        self.integrated: list[int] = []
        """Blocks that each frame was integrated into."""

    def fuse(self, frame: Frame) -> None:
        """Integrate one frame."""
        o3d = self._o3d
        depth = o3d.t.geometry.Image(o3d.core.Tensor(frame.depth[..., None]))
        intrinsic = o3d.core.Tensor(frame.intrinsics.matrix)
        extrinsic = o3d.core.Tensor(np.ascontiguousarray(invert(frame.T_map_camera)))
        with self.clock.frame():
            blocks = self._grid.compute_unique_block_coordinates(depth, intrinsic, extrinsic, *self._range)
            self._grid.integrate(blocks, depth, intrinsic, extrinsic, *self._range)
        self.integrated.append(len(blocks))

    @property
    def blocks(self) -> int:
        """Blocks in use."""
        return int(self._grid.hashmap().size())


def fastest_resolution(
    open3d: Any, frames: Sequence[Frame], voxel_size: float, truncation: float, depth_max: float
) -> int:
    """Of 8 and 16 voxels a side, the block with the least median time over these frames."""
    medians: dict[int, float] = {}
    for resolution in RESOLUTIONS:
        grid = Open3dGrid(open3d, voxel_size, truncation, depth_max, resolution)
        for frame in frames:
            grid.fuse(frame)
        medians[resolution] = float(np.median(grid.clock.seconds))
    return min(medians, key=lambda resolution: medians[resolution])
