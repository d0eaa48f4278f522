"""TUM RGB-D (Sturm et al. 2012): lists of images with times, poses as translation and quaternion."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import InputError
from uppm.core.types import Intrinsics
from uppm.datasets import files, trajectory
from uppm.datasets.sequence import RawFrame, RawSequence
from uppm.datasets.times import nearest

PUBLISHED = {
    "1": (517.3, 516.5, 318.6, 255.3),
    "2": (520.9, 521.0, 325.1, 249.7),
    "3": (535.4, 539.2, 320.1, 247.6),
}
"""fx, fy, cx, cy of the benchmark's three cameras at 640x480."""


class Tum:
    looks_for = "rgb.txt, depth.txt, groundtruth.txt"

    @staticmethod
    def matches(path: Path) -> bool:
        return (path / "rgb.txt").exists() and (path / "depth.txt").exists()

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        color_times, color = _image_list(path / "rgb.txt")
        depth_times, depth = _image_list(path / "depth.txt")
        pose_times, poses = trajectory.read_trajectory(path / "groundtruth.txt")
        gap = config.time_tolerance
        of_depth, of_pose = nearest(color_times, depth_times, gap), nearest(color_times, pose_times, gap)
        used = np.flatnonzero((of_depth >= 0) & (of_pose >= 0))
        if not used.size:
            found = f"{len(color)} colour, {len(depth)} depth images and {len(poses)} poses with no common time"
            advice = "check that the three files use one clock, or raise input.time_tolerance"
            raise InputError(path, expected=f"times within {gap} s", found=found, advice=advice)
        frames = [
            RawFrame(
                where=str(path / color[i]),
                pose_where=f"{path / 'groundtruth.txt'}, time {pose_times[of_pose[i]]:.6f}",
                stamp=float(color_times[i]),
                color=partial(files.read_color, path / color[i]),
                depth=partial(files.read_depth, path / depth[of_depth[i]]),
                pose=poses[of_pose[i]].copy,
            )
            for i in used
        ]
        size = files.common_size([path / name for name in color], [path / name for name in depth], path)
        camera, source = _intrinsics(path, size)
        return RawSequence(
            format="tum",
            name=path.resolve().name,
            frames=frames,
            color=camera,
            depth=camera,
            depth_scale=5000.0,
            quaternions=True,
            intrinsics_source=source,
        )


def _image_list(path: Path) -> tuple[npt.NDArray[np.float64], list[str]]:
    rows = trajectory.rows(path)
    values = files.parse_numbers(" ".join(row[0] for row in rows))
    if not rows or values is None or any(len(row) != 2 for row in rows):
        found, advice = "other lines" if rows else "no line", "see docs/datasets.md"
        raise InputError(path, expected="lines of a time and a file name", found=found, advice=advice)
    return values, [row[1] for row in rows]


def _intrinsics(path: Path, size: tuple[int, int]) -> tuple[Intrinsics, str]:
    file = path / "intrinsics.txt"
    camera = re.search(r"(?:freiburg|fr)([123])", path.resolve().name)
    if not file.exists() and camera and size == (640, 480):
        fx, fy, cx, cy = PUBLISHED[camera[1]]
        return Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, width=640, height=480), f"TUM's freiburg{camera[1]} camera"
    if not file.exists():
        found = f"a folder {path.resolve().name!r} of {size[0]}x{size[1]} images that does not name TUM's camera"
        advice = "write the 3x3 camera matrix there"
        raise InputError(file, expected="intrinsics, or a freiburg1, 2 or 3 folder", found=found, advice=advice)
    return files.read_intrinsics(file, size), str(file)
