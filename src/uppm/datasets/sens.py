"""ScanNet's .sens container, version 4: a header, then frames of pose, JPEG colour and zlib 16-bit depth."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from uppm.core.errors import BadFrameError, InputError
from uppm.datasets import files
from uppm.datasets.sequence import RawFrame, RawSequence

COLOR_ENCODED = (1, 2)
"""PNG and JPEG, which both name themselves."""
DEPTH_RAW, DEPTH_ZLIB = 0, 1
_FRAME = struct.Struct("<16f4Q")
_SHAPES = struct.Struct("<2i4IfQ")
MICROSECONDS = 1e-6


@dataclass(frozen=True)
class _Header:
    matrices: npt.NDArray[np.float64]
    """(4, 4, 4): intrinsics and extrinsics of colour, then of depth."""
    depth_compression: int
    color_size: tuple[int, int]
    depth_size: tuple[int, int]
    depth_shift: float
    frames: int


def read_sens(path: Path) -> RawSequence:
    """Index the file's frames; images are read when asked for.

    A file that ends within a frame is an `InputError`: a download was cut.
    """
    with path.open("rb") as file:
        header = _header(path, file)
        frames = [_frame(path, file, header, i) for i in range(header.frames)]
    K_color, E_color, K_depth, E_depth = header.matrices
    return RawSequence(
        format="scannet",
        name=path.stem,
        frames=frames,
        color=files.intrinsics_of(K_color, header.color_size, path),
        depth=files.intrinsics_of(K_depth, header.depth_size, path),
        T_color_depth=np.linalg.inv(E_color) @ E_depth,
        depth_scale=header.depth_shift,
        intrinsics_source=str(path),
    )


def _take(path: Path, file: BinaryIO, count: int) -> bytes:
    data = file.read(count)
    if len(data) != count:
        found = f"its end after {file.tell()} bytes"
        raise InputError(path, expected="a whole .sens file", found=found, advice="fetch or copy the file again")
    return data


def _header(path: Path, file: BinaryIO) -> _Header:
    version, length = struct.unpack("<IQ", _take(path, file, 12))
    if version != 4 or length > 4096:
        found, advice = f"version {version}", "export it with ScanNet's SensReader to folders"
        raise InputError(path, expected="a .sens file of version 4", found=found, advice=advice)
    _take(path, file, length)
    matrices = np.frombuffer(_take(path, file, 4 * 64), "<f4").astype(np.float64).reshape(4, 4, 4)
    color, depth, cw, ch, dw, dh, shift, frames = _SHAPES.unpack(_take(path, file, _SHAPES.size))
    if color not in COLOR_ENCODED or depth not in (DEPTH_RAW, DEPTH_ZLIB) or not shift > 0:
        found = f"colour kind {color}, depth kind {depth}, depth shift {shift}"
        expected, advice = "JPEG or PNG colour and raw or zlib depth", "export it with ScanNet's SensReader to folders"
        raise InputError(path, expected=expected, found=found, advice=advice)
    if not np.isfinite(matrices).all():
        raise InputError(path, expected="finite calibration", found="NaN or infinity", advice="fetch the file again")
    return _Header(matrices, depth, (cw, ch), (dw, dh), shift, frames)


def _frame(path: Path, file: BinaryIO, header: _Header, index: int) -> RawFrame:
    *pose, color_time, _, color_bytes, depth_bytes = _FRAME.unpack(_take(path, file, _FRAME.size))
    where, start = f"{path}, frame {index}", file.tell()
    end = start + color_bytes + depth_bytes
    if end > path.stat().st_size:
        found = f"its end within frame {index} of {header.frames}"
        raise InputError(path, expected="a whole .sens file", found=found, advice="fetch or copy the file again")
    file.seek(end)
    return RawFrame(
        where=where,
        pose_where=where,
        stamp=color_time * MICROSECONDS if color_time else index / files.FRAME_RATE,
        color=partial(_color, path, where, start, color_bytes),
        depth=partial(_depth, path, where, start + color_bytes, depth_bytes, header),
        pose=np.array(pose, dtype=np.float64).reshape(4, 4).copy,
    )


def _bytes(path: Path, start: int, count: int) -> bytes:
    with path.open("rb") as file:
        file.seek(start)
        return file.read(count)


def _color(path: Path, where: str, start: int, count: int) -> npt.NDArray[np.uint8]:
    return files.decode_color(_bytes(path, start, count), where)


def _depth(path: Path, where: str, start: int, count: int, header: _Header) -> npt.NDArray[np.uint16]:
    data = _bytes(path, start, count)
    width, height = header.depth_size
    try:
        data = zlib.decompress(data) if header.depth_compression == DEPTH_ZLIB else data
    except zlib.error:
        data = b""
    if len(data) != 2 * width * height:
        found, advice = "a truncated or unreadable image", "fetch the file again or leave the frame out"
        raise BadFrameError(where, expected=f"depth of {width}x{height}", found=found, advice=advice)
    return np.frombuffer(data, "<u2").reshape(height, width)
