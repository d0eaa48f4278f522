"""The flat dataset of Panoptic Multi-TSDFs (Schmid et al. 2022)."""

from __future__ import annotations

import csv
from functools import partial
from pathlib import Path

import numpy as np

from uppm.core.config import InputConfig
from uppm.core.errors import InputError
from uppm.core.types import GroundTruth, Intrinsics
from uppm.datasets import files
from uppm.datasets.sequence import RawFrame, RawSequence

NANOSECONDS = 1e-9
LABELS = "groundtruth_labels.csv"


class PanmapFlat:
    looks_for = "NNNNNN_color.png, _depth.tiff, _pose.txt, timestamps.csv"

    @staticmethod
    def matches(path: Path) -> bool:
        return path.is_dir() and any(path.glob("*_depth.tiff"))

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        color = files.numbered(path, r"(\d+)_color\.png")
        depth = files.numbered(path, r"(\d+)_depth\.tiff")
        stamps = _stamps(path / "timestamps.csv")
        labels = next((file for file in (path / LABELS, path.resolve().parent / LABELS) if file.exists()), None)
        names, things = _labels(labels)
        frames = [
            RawFrame(
                where=str(path / f"{number:06d}"),
                pose_where=str(path / f"{number:06d}_pose.txt"),
                stamp=stamps.get(number, number / files.FRAME_RATE),
                color=partial(files.read_color, path / f"{number:06d}_color.png"),
                depth=partial(files.read_depth, path / f"{number:06d}_depth.tiff"),
                pose=partial(files.read_pose, path / f"{number:06d}_pose.txt"),
                truth=partial(_truth, path / f"{number:06d}_segmentation.png", names, things),
            )
            for number in files.paired(color, depth, path)
        ]
        size = files.common_size(color.values(), depth.values(), path)
        source = path / "intrinsics.txt"
        published = Intrinsics(fx=320, fy=320, cx=320, cy=240, width=size[0], height=size[1])
        camera = files.read_intrinsics(source, size) if source.exists() or size != (640, 480) else published
        return RawSequence(
            format="panmap-flat",
            name=path.resolve().name,
            frames=frames,
            color=camera,
            depth=camera,
            depth_scale=1.0,
            intrinsics_source=str(source),
        )


def _table(path: Path, *columns: str) -> list[dict[str, str]]:
    rows = list(csv.DictReader(files.read_text(path).splitlines(), skipinitialspace=True))
    if missing := [name for name in columns if rows and rows[0].get(name) is None]:
        found, advice = f"no column {missing[0]}", "restore the file"
        raise InputError(path, expected=f"columns {', '.join(columns)}", found=found, advice=advice)
    return rows


def _stamps(path: Path) -> dict[int, float]:
    """Image number -> seconds since the first image."""
    if not path.exists():
        return {}
    try:
        times = {int(row["ImageID"]): float(row["TimeStamp"]) for row in _table(path, "ImageID", "TimeStamp")}
    except (TypeError, ValueError) as error:
        raise InputError(path, expected="numbers", found=str(error), advice="restore the file") from None
    start = min(times.values(), default=0.0)
    return {number: (time - start) * NANOSECONDS for number, time in times.items()}


def _labels(path: Path | None) -> tuple[dict[int, str], frozenset[int]]:
    if path is None:
        return {}, frozenset()
    rows = _table(path, "InstanceID", "PanopticID", "Name")
    try:
        names = {int(row["InstanceID"]): row["Name"] for row in rows}
        return names, frozenset(int(row["InstanceID"]) for row in rows if int(row["PanopticID"]) == 1)
    except (TypeError, ValueError) as error:
        raise InputError(path, expected="whole numbers", found=str(error), advice="restore the file") from None


def _truth(path: Path, names: dict[int, str], things: frozenset[int]) -> GroundTruth | None:
    """Unnamed instances become unknown: the published table leaves some out."""
    if not names or not path.exists():
        return None
    ids = files.read_ids(path)
    return GroundTruth(
        instance=np.where(np.isin(ids, list(names)), ids, 0).astype(np.int32), names=names, things=things
    )
