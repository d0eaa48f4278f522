"""The `frames` layout, the one to convert to (docs/datasets.md)."""

from __future__ import annotations

import csv
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError, InputError
from uppm.core.types import GroundTruth
from uppm.datasets import files
from uppm.datasets.sequence import RawFrame, RawSequence


class Frames:
    looks_for = "color/, depth/, pose/, intrinsics.txt"

    @staticmethod
    def matches(path: Path) -> bool:
        return (path / "color").is_dir() and not (path / "intrinsic").is_dir()

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        color = files.numbered(path / "color", r"(\d+)" + files.IMAGE)
        depth = files.numbered(path / "depth", r"(\d+)\.(?:png|tiff?)")
        positions = files.paired(color, depth, path)
        poses = files.numbered(path / "pose", r"(\d+)\.txt")
        if not poses:
            raise InputError(
                path / "pose", expected="NNNNN.txt of 4x4 poses", found="none", advice="see docs/datasets.md"
            )
        names, things = _labels(path / "labels.csv")
        stamps = _stamps(path / "stamps.txt", len(positions))
        frames = [
            RawFrame(
                where=f"{path}, frame {number:05d}",
                pose_where=str(poses.get(number, path / "pose" / f"{number:05d}.txt")),
                stamp=stamps[i],
                color=partial(files.read_color, color.get(number, path / "color" / f"{number:05d}.jpg")),
                depth=partial(files.read_depth, depth.get(number, path / "depth" / f"{number:05d}.png")),
                pose=partial(files.read_pose, poses.get(number, path / "pose" / f"{number:05d}.txt")),
                truth=partial(_truth, path / "instance", color.get(number), names, things),
            )
            for i, number in enumerate(positions)
        ]
        return _sequence(path, frames, list(color.values()), list(depth.values()))


def truth_surface(path: str | Path) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]] | None:
    """Points (N, 3), metres, frame map, and instance ids (N,) of a `frames` folder's surface.npz, where it has one."""
    file = Path(path) / "surface.npz"
    if not file.exists():
        return None
    try:
        with np.load(file, allow_pickle=False) as data:
            return (data["xyz_mm"] / np.float32(1000)).astype(np.float32), data["instance"].astype(np.int32)
    except (OSError, ValueError, KeyError) as error:
        expected, found = "arrays xyz_mm (N, 3) and instance (N,)", str(error).replace("\n", " ")
        raise InputError(file, expected=expected, found=found, advice="restore or delete it") from None


def _sequence(path: Path, frames: list[RawFrame], color: list[Path], depth: list[Path]) -> RawSequence:
    own = path / "depth_intrinsics.txt"
    extrinsics = path / "T_color_depth.txt"
    if own.exists():
        size, depth_size = files.image_size(color, "colour", path), files.image_size(depth, "depth", path)
        T_color_depth = files.read_matrix(extrinsics, 4) if extrinsics.exists() else np.eye(4)
    else:
        size = depth_size = files.common_size(color, depth, path)
        T_color_depth = None
    camera = files.read_intrinsics(path / "intrinsics.txt", size)
    return RawSequence(
        format="frames",
        name=path.resolve().name,
        frames=frames,
        color=camera,
        depth=files.read_intrinsics(own, depth_size) if own.exists() else camera,
        T_color_depth=T_color_depth,
        depth_scale=1.0 if depth[0].suffix.startswith(".tif") else 1000.0,
        intrinsics_source=str(path / "intrinsics.txt"),
    )


def _stamps(path: Path, count: int) -> list[float]:
    if not path.exists():
        return [i / files.FRAME_RATE for i in range(count)]
    return files.read_stamps(path, count)


def _labels(path: Path) -> tuple[dict[int, str], frozenset[int]]:
    if not path.exists():
        return {}, frozenset()
    try:
        rows = list(csv.DictReader(files.read_text(path).splitlines()))
        names = {int(row["instance"]): row["name"] for row in rows}
        return names, frozenset(int(row["instance"]) for row in rows if int(row["thing"]))
    except (KeyError, TypeError, ValueError) as error:
        expected, found = "columns instance, name, thing (0 or 1)", f"a row without them ({error})"
        raise InputError(path, expected=expected, found=found, advice="see docs/datasets.md, or delete it") from None


def _truth(folder: Path, color: Path | None, names: dict[int, str], things: frozenset[int]) -> GroundTruth | None:
    if not names or color is None or not folder.is_dir():
        return None
    path = folder / f"{color.stem}.png"
    instance = files.read_ids(path)
    if unnamed := set(np.unique(instance).tolist()) - names.keys() - {0}:
        found = f"instance {min(unnamed)} that labels.csv does not name"
        raise BadFrameError(path, expected="instances of labels.csv", found=found, advice="add its row to labels.csv")
    return GroundTruth(instance=instance, names=names, things=things)
