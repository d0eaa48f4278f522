"""3RScan (Wald et al. 2019): sequence/ or sequence.zip with _info.txt; colour and depth of different size."""

from __future__ import annotations

import re
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import InputError
from uppm.datasets import files
from uppm.datasets.sequence import RawFrame, RawSequence

INFO = "_info.txt"


class ThreeRScan:
    looks_for = "sequence/_info.txt or sequence.zip"

    @staticmethod
    def matches(path: Path) -> bool:
        return path.name == "sequence.zip" or any(
            (path / name).exists() for name in (INFO, f"sequence/{INFO}", "sequence.zip")
        )

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        root = _root(path)
        info = _info(root / INFO)
        numbers = _numbers(root)
        if not numbers:
            found, advice = "none", "see docs/datasets.md"
            raise InputError(str(root), expected="frame-NNNNNN.color.jpg", found=found, advice=advice)
        frames = [
            RawFrame(
                where=str(root / f"frame-{number:06d}"),
                pose_where=str(root / f"frame-{number:06d}.pose.txt"),
                stamp=number / files.FRAME_RATE,
                color=partial(files.read_color, root / f"frame-{number:06d}.color.jpg"),
                depth=partial(files.read_depth, root / f"frame-{number:06d}.depth.pgm"),
                pose=partial(files.read_pose, root / f"frame-{number:06d}.pose.txt"),
            )
            for number in numbers
        ]
        return _sequence(path, str(root / INFO), info, frames)


def _root(path: Path) -> Path | zipfile.Path:
    """The folder with the frames; inside a zip file they may lie in a folder `sequence`."""
    for folder in (path, path / "sequence"):
        if (folder / INFO).exists():
            return folder
    archive = path if path.suffix == ".zip" else path / "sequence.zip"
    try:
        # Frames are read as long as the sequence is used: the archive stays open with it.
        root = zipfile.Path(zipfile.ZipFile(archive))
    except (OSError, zipfile.BadZipFile) as error:
        raise InputError(archive, expected="a zip file", found=str(error), advice="fetch the file again") from None
    return root if (root / INFO).exists() else root / "sequence/"


def _numbers(root: Path | zipfile.Path) -> list[int]:
    matches = (re.fullmatch(r"frame-(\d+)\.color\.jpg", entry.name) for entry in root.iterdir())
    return sorted(int(match[1]) for match in matches if match)


def _info(path: Path | zipfile.Path) -> dict[str, str]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, KeyError, UnicodeDecodeError):
        raise InputError(str(path), expected="a text file", found="none", advice="see docs/datasets.md") from None
    lines = (line.partition("=") for line in text.splitlines())
    return {key.strip(): value.strip() for key, equals, value in lines if equals}


def _values(info: dict[str, str], key: str, where: str, count: int) -> npt.NDArray[np.float64]:
    values = files.parse_numbers(info.get(key, ""))
    if values is None or len(values) != count or not np.isfinite(values).all():
        found = repr(info[key]) if key in info else "nothing"
        raise InputError(where, expected=f"{key} = {count} numbers", found=found, advice="restore the file")
    return values


def _sequence(path: Path, where: str, info: dict[str, str], frames: list[RawFrame]) -> RawSequence:
    def number(key: str) -> float:
        return float(_values(info, key, where, 1)[0])

    def matrix(key: str) -> npt.NDArray[np.float64]:
        return _values(info, key, where, 16).reshape(4, 4)

    size, depth_size = ((int(number(f"m_{c}Width")), int(number(f"m_{c}Height"))) for c in ("color", "depth"))
    E_color, E_depth = (matrix(f"m_calibration{c}Extrinsic") for c in ("Color", "Depth"))
    scan = path.resolve().parent if path.name.startswith("sequence") else path.resolve()
    return RawSequence(
        format="3rscan",
        name=scan.name,
        frames=frames,
        color=files.intrinsics_of(matrix("m_calibrationColorIntrinsic"), size, where),
        depth=files.intrinsics_of(matrix("m_calibrationDepthIntrinsic"), depth_size, where),
        T_color_depth=np.linalg.inv(E_color) @ E_depth,
        depth_scale=number("m_depthShift"),
        intrinsics_source=where,
    )
