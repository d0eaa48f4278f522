"""ScanNet (Dai et al. 2017), exported to folders, or as one .sens file (see sens.py)."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.datasets import files, sens
from uppm.datasets.sequence import RawFrame, RawSequence


class ScanNet:
    looks_for = "a .sens file, or color/, depth/, pose/, intrinsic/"

    @staticmethod
    def matches(path: Path) -> bool:
        return path.suffix == ".sens" or (path / "intrinsic").is_dir() or len(_sens_files(path)) == 1

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        if path.suffix == ".sens":
            return sens.read_sens(path)
        if not (path / "color").is_dir() and _sens_files(path):
            return sens.read_sens(_sens_files(path)[0])
        return _exported(path)


def _sens_files(path: Path) -> list[Path]:
    return sorted(path.glob("*.sens")) if path.is_dir() else []


def _exported(path: Path) -> RawSequence:
    color = files.numbered(path / "color", r"(\d+)" + files.IMAGE)
    depth = files.numbered(path / "depth", r"(\d+)\.png")
    frames = [
        RawFrame(
            where=f"{path}, frame {number}",
            pose_where=str(path / "pose" / f"{number}.txt"),
            stamp=number / files.FRAME_RATE,
            color=partial(files.read_color, color.get(number, path / "color" / f"{number}.jpg")),
            depth=partial(files.read_depth, depth.get(number, path / "depth" / f"{number}.png")),
            pose=partial(files.read_pose, path / "pose" / f"{number}.txt"),
        )
        for number in files.paired(color, depth, path)
    ]
    folder = path / "intrinsic"
    K_color, K_depth = (folder / f"intrinsic_{name}.txt" for name in ("color", "depth"))
    E_color, E_depth = (_extrinsic(folder / f"extrinsic_{name}.txt") for name in ("color", "depth"))
    size, depth_size = (
        files.image_size(images.values(), what, path) for images, what in ((color, "colour"), (depth, "depth"))
    )
    return RawSequence(
        format="scannet",
        name=path.resolve().name,
        frames=frames,
        color=files.intrinsics_of(files.read_matrix(K_color, 4), size, K_color),
        depth=files.intrinsics_of(files.read_matrix(K_depth, 4), depth_size, K_depth),
        T_color_depth=np.linalg.inv(E_color) @ E_depth,
        intrinsics_source=str(K_color),
    )


def _extrinsic(path: Path) -> npt.NDArray[np.float64]:
    """Camera to the pair's common frame; the identity where an export left it out."""
    return files.read_matrix(path, 4) if path.exists() else np.eye(4)
