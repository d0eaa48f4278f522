"""Images, matrices and numbered files, each with an error that names the file."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.errors import BadFrameError, InputError
from uppm.core.types import Intrinsics

IMAGE = r"\.(?:jpg|jpeg|png)"
FRAME_RATE = 30.0
"""Frames a second where a format has no time stamps."""


class Readable(Protocol):
    """A `pathlib.Path`, or a path in a zip file."""

    @property
    def name(self) -> str: ...

    def read_bytes(self) -> bytes: ...


def read_bytes(path: Readable) -> bytes:
    """A frame's file; raises `BadFrameError` where there is none."""
    try:
        return path.read_bytes()
    except (OSError, KeyError):
        advice = "restore the file or leave the frame out"
        raise BadFrameError(str(path), expected="a file", found="a missing file", advice=advice) from None


def read_color(path: Readable) -> npt.NDArray[np.uint8]:
    """(H, W, 3) RGB image of a JPEG or PNG file."""
    return decode_color(read_bytes(path), str(path))


def read_depth(path: Readable, invalid: int | None = None) -> npt.NDArray[np.generic]:
    """(H, W) depth image in the file's units (uint16 or float32); pixels equal to `invalid` become 0."""
    depth = decode(read_bytes(path), str(path), cv2.IMREAD_UNCHANGED)
    if depth.ndim != 2 or depth.dtype not in (np.uint16, np.float32):
        found = f"an image of {depth.dtype} with {1 if depth.ndim == 2 else depth.shape[2]} channels"
        advice = "export depth as 16-bit PNG or float TIFF, one channel"
        raise BadFrameError(str(path), expected="a depth image of uint16 or float32", found=found, advice=advice)
    if invalid is not None:
        depth[depth == invalid] = 0
    return depth


def decode_color(data: bytes, where: str) -> npt.NDArray[np.uint8]:
    """(H, W, 3) RGB image of an encoded one."""
    return cv2.cvtColor(decode(data, where, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def decode(data: bytes, where: str, flags: int) -> npt.NDArray:
    """Image of its encoded bytes; raises `BadFrameError` where they are cut short or cannot be decoded."""
    # OpenCV pads what is missing of a truncated JPEG or PNG with grey or black, so the end marks are looked for.
    cut = (data[:2] == b"\xff\xd8" and b"\xff\xd9" not in data[-1024:]) or (
        data[:4] == b"\x89PNG" and b"IEND" not in data[-64:]
    )
    image = None
    if data and not cut:
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags | cv2.IMREAD_IGNORE_ORIENTATION)
        except cv2.error:
            image = None
    if image is None:
        advice = "restore the file or leave the frame out"
        raise BadFrameError(where, expected="an image", found="a truncated or unreadable image", advice=advice)
    return image


def numbers(path: Readable, count: int, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """The `count` numbers of a frame's text file, as an array of `shape`."""
    text = read_bytes(path).decode("utf-8", "replace")
    values = parse_numbers(text)
    if values is None or len(values) != count:
        found = "text that is not numbers" if values is None else "another count of numbers in the pose file"
        raise BadFrameError(str(path), expected=f"{count} numbers", found=found, advice="write the file again")
    return values.reshape(shape)


def read_pose(path: Readable) -> npt.NDArray[np.float64]:
    """(4, 4) pose of a text file with 16 numbers, row by row."""
    return numbers(path, 16, (4, 4))


def parse_numbers(text: str) -> npt.NDArray[np.float64] | None:
    """Numbers separated by blanks or commas; None where something else is there."""
    try:
        return np.array([float(word) for word in text.replace(",", " ").split()])
    except ValueError:
        return None


def pose_lines(path: Path, count: int) -> npt.NDArray[np.float64]:
    """(count, 4, 4) poses of a file with 16 numbers a line; raises `InputError` where the counts differ."""
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    rows = [parse_numbers(line) for line in lines]
    bad = next((i for i, row in enumerate(rows) if row is None or len(row) != 16), None)
    if bad is not None:
        advice = "write one pose a line, row by row"
        raise InputError(path, expected="16 numbers a line", found=f"another count in line {bad + 1}", advice=advice)
    if len(rows) != count:
        found, advice = f"{len(rows)} lines", "give each image its pose"
        raise InputError(path, expected=f"{count} lines, one for each image", found=found, advice=advice)
    return np.array(rows, dtype=np.float64).reshape(-1, 4, 4)


def read_text(path: Path) -> str:
    """A file that the whole sequence needs; raises `InputError` where there is none."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        found = "something else" if path.exists() else "nothing there"
        raise InputError(path, expected="a text file", found=found, advice="see docs/datasets.md") from None


def read_stamps(path: Path, count: int) -> list[float]:
    """One time in seconds for each of `count` frames."""
    values = parse_numbers(read_text(path))
    if values is None or len(values) != count or not np.isfinite(values).all():
        found = "other text" if values is None else f"{len(values)} numbers or one not finite"
        raise InputError(
            path, expected=f"{count} numbers, seconds", found=found, advice="write one a line, or delete it"
        )
    return values.tolist()


def read_matrix(path: Path, size: int) -> npt.NDArray[np.float64]:
    """(size, size) finite matrix of a text file."""
    values = parse_numbers(read_text(path))
    found = None
    if values is None:
        found = "text that is not numbers"
    elif values.size != size * size:
        found = f"{values.size} numbers"
    elif not np.isfinite(values).all():
        found = "NaN or infinity"
    if values is None or found:
        advice = "write it row by row"
        raise InputError(path, expected=f"a {size}x{size} matrix", found=found or "", advice=advice)
    return values.reshape(size, size)


def intrinsics_of(K: npt.NDArray[np.float64], size: tuple[int, int], where: str | Path) -> Intrinsics:
    """Intrinsics of a camera matrix (3x3, or 4x4 whose upper left is) and an image size (width, height)."""
    pinhole = [[K[0, 0], 0, K[0, 2]], [0, K[1, 1], K[1, 2]], [0, 0, 1]]
    if not (K[0, 0] > 0 and K[1, 1] > 0 and np.allclose(K[:3, :3], pinhole, atol=1e-6)):
        expected = "a camera matrix fx 0 cx; 0 fy cy; 0 0 1"
        found = "; ".join(" ".join(f"{value:g}" for value in row[:3]) for row in K[:3])
        raise InputError(where, expected=expected, found=found, advice="write it row by row, in pixels")
    fx, fy, cx, cy = (float(K[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, width=size[0], height=size[1])


def read_intrinsics(path: Path, size: tuple[int, int]) -> Intrinsics:
    """Intrinsics of a text file with a 3x3 camera matrix."""
    return intrinsics_of(read_matrix(path, 3), size, path)


def numbered(folder: Path, pattern: str) -> dict[int, Path]:
    """Number -> file, in order of the numbers; `pattern` matches the name and captures the number."""
    matches = ((re.fullmatch(pattern, path.name), path) for path in folder.iterdir()) if folder.is_dir() else ()
    return dict(sorted((int(match[1]), path) for match, path in matches if match))


def image_size(paths: Iterable[Readable], what: str, where: str | Path) -> tuple[int, int]:
    """(width, height) of the first image that can be read of the first twenty."""
    for _, path in zip(range(20), paths, strict=False):
        try:
            height, width = decode(read_bytes(path), str(path), cv2.IMREAD_UNCHANGED).shape[:2]
        except BadFrameError:
            continue
        return width, height
    advice = "check the files"
    raise InputError(where, expected=f"readable {what} images", found="none that can be decoded", advice=advice)


def common_size(color: Iterable[Readable], depth: Iterable[Readable], where: str | Path) -> tuple[int, int]:
    """The size that colour and depth share; raises `InputError` where they differ and one camera is given."""
    size, depth_size = image_size(color, "colour", where), image_size(depth, "depth", where)
    if size != depth_size:
        found = f"colour of {size[0]}x{size[1]} and depth of {depth_size[0]}x{depth_size[1]}"
        advice = "register depth to colour, or convert to the frames layout with depth_intrinsics.txt"
        raise InputError(where, expected="colour and depth of one size", found=found, advice=advice)
    return size


def paired(color: dict[int, Path], depth: dict[int, Path], where: Path) -> list[int]:
    """Numbers that have colour or depth; raises `InputError` where one kind is absent or no number has both."""
    for what, files in (("colour", color), ("depth", depth)):
        if not files:
            other = "depth" if what == "colour" else "colour"
            found = f"no {what} images" + (f" but {len(color or depth)} {other} images" if color or depth else "")
            raise InputError(where, expected="colour and depth images", found=found, advice="see docs/datasets.md")
    if not color.keys() & depth.keys():
        found = f"{len(color)} colour and {len(depth)} depth images with no number in common"
        raise InputError(where, expected="numbers that match", found=found, advice="name both by the frame's number")
    return sorted(color.keys() | depth.keys())


def read_ids(path: Readable) -> npt.NDArray[np.int32]:
    """(H, W) instance image of an 8- or 16-bit PNG."""
    ids = decode(read_bytes(path), str(path), cv2.IMREAD_UNCHANGED)
    if ids.ndim == 3 and (ids == ids[..., :1]).all():
        ids = ids[..., 0]
    if ids.ndim != 2 or ids.dtype not in (np.uint8, np.uint16):
        found = f"an image of {ids.dtype} with shape {ids.shape}"
        raise BadFrameError(str(path), expected="an 8- or 16-bit id image", found=found, advice="export it again")
    return ids.astype(np.int32)
