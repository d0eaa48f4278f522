"""Record3D's export: a zip of JPEG colour and LZFSE-compressed float depth, as the app writes on an iPhone or iPad."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError, InputError, MissingExtraError
from uppm.core.geometry import pose_from_quaternion
from uppm.core.types import Intrinsics
from uppm.datasets import files
from uppm.datasets.poses import OPENGL_CAMERA
from uppm.datasets.sequence import RawFrame, RawSequence

COMMAND = "pip install uppm[record3d]"
DEPTH_SIZES = (192, 256), (256, 192), (480, 640), (640, 480)
"""Width and height of LiDAR and TrueDepth images, either way up, where the file does not say."""
LOW_CONFIDENCE = 0
"""ARKit's lowest of three: such depth is left out."""

Decompress = Callable[[bytes], bytes]


class Record3D:
    looks_for = "a .r3d file"

    @staticmethod
    def matches(path: Path) -> bool:
        return path.suffix.lower() == ".r3d"

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        decompress = _decompressor()
        root = _root(path)
        metadata = _metadata(path, root)
        names = (re.fullmatch(r"(\d+)\.jpg", entry.name) for entry in (root / "rgbd").iterdir())
        numbers = sorted(int(match[1]) for match in names if match)
        if not numbers:
            raise InputError(path, expected="rgbd/0.jpg", found="no colour image", advice="export it again as .r3d")
        camera = _camera(path, metadata)
        first = partial(_floats, root / "rgbd" / f"{numbers[0]}.depth", decompress)
        depth = _depth_camera(path, metadata, camera, first)
        poses, stamps = _poses(path, metadata), _stamps(metadata, numbers)
        return RawSequence(
            format="record3d",
            name=path.resolve().name,
            frames=[_frame(path, root, n, stamps[n], poses, depth, decompress) for n in numbers],
            color=camera,
            depth=depth,
            T_color_depth=np.eye(4),
            depth_scale=1.0,
            intrinsics_source=f"{path}, metadata",
        )


def _decompressor() -> Decompress:
    """Unpacks LZFSE; gives nothing of what is damaged."""
    try:
        import lzfse
    except ImportError:
        raise MissingExtraError("lzfse, which unpacks Record3D's depth,", COMMAND) from None

    def decompress(data: bytes) -> bytes:
        try:
            return lzfse.decompress(data)
        except lzfse.error:
            return b""

    return decompress


def _root(path: Path) -> zipfile.Path:
    try:
        # Frames are read as long as the sequence is used: the archive stays open with it.
        root = zipfile.Path(zipfile.ZipFile(path))
    except (OSError, zipfile.BadZipFile) as error:
        raise InputError(path, expected="a zip file", found=str(error), advice="copy the export again") from None
    if not (root / "metadata").exists() or not (root / "rgbd").is_dir():
        found, advice = "a zip file without them", "export it from Record3D as .r3d, not as another format"
        raise InputError(path, expected="metadata and rgbd/ in the zip file", found=found, advice=advice)
    return root


def _metadata(path: Path, root: zipfile.Path) -> dict[str, Any]:
    try:
        metadata = json.loads((root / "metadata").read_bytes())
    except ValueError as error:
        raise InputError(
            path, expected="metadata in JSON", found=str(error), advice="export the recording again"
        ) from None
    missing = {"w", "h", "K"} - set(metadata if isinstance(metadata, dict) else ())
    if missing:
        found = f"none of {', '.join(sorted(missing))}"
        raise InputError(path, expected="metadata with w, h and K", found=found, advice="export the recording again")
    return metadata


def _array(path: Path, metadata: dict[str, Any], key: str, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """A field's numbers; -1 in `shape`: any count."""
    try:
        return np.array(metadata.get(key, []), dtype=np.float64).reshape(shape)
    except (ValueError, TypeError):
        expected = f"{key} of {' x '.join('any count' if n < 0 else str(n) for n in shape)} numbers in the metadata"
        raise InputError(path, expected=expected, found="others", advice="export the recording again") from None


def _camera(path: Path, metadata: dict[str, Any]) -> Intrinsics:
    K = _array(path, metadata, "K", (3, 3))
    if not np.allclose(K[2], (0, 0, 1)):
        K = K.T  # written column by column
    return files.intrinsics_of(K, (int(metadata["w"]), int(metadata["h"])), f"{path}, metadata")


def _depth_camera(
    path: Path, metadata: dict[str, Any], color: Intrinsics, first: Callable[[], npt.NDArray[np.float32]]
) -> Intrinsics:
    """The colour camera at the depth images' size: ARKit registers depth to colour, and makes it coarser."""
    count = first().size
    sizes = [(int(metadata["dw"]), int(metadata["dh"]))] if {"dw", "dh"} <= metadata.keys() else DEPTH_SIZES
    aspect = color.width / color.height
    fitting = [s for s in (*sizes, (color.width, color.height)) if s[0] * s[1] == count]
    if not fitting:
        expected = f"depth images of {' or '.join(f'{w}x{h}' for w, h in sizes)}"
        raise InputError(path, expected=expected, found=f"{count} values", advice="export the recording again")
    width, height = min(fitting, key=lambda size: abs(size[0] / size[1] - aspect))
    return at_size(color, width, height)


def at_size(camera: Intrinsics, width: int, height: int) -> Intrinsics:
    """The same camera with coarser or finer pixels."""
    x, y = width / camera.width, height / camera.height
    cx, cy = (camera.cx + 0.5) * x - 0.5, (camera.cy + 0.5) * y - 0.5
    return Intrinsics(fx=camera.fx * x, fy=camera.fy * y, cx=cx, cy=cy, width=width, height=height)


def _poses(path: Path, metadata: dict[str, Any]) -> npt.NDArray[np.float64]:
    """(N, 7): quaternion x, y, z, w and translation, camera to world with OpenGL axes."""
    poses = _array(path, metadata, "poses", (-1, 7))
    if not len(poses):
        advice = "record with the LiDAR camera; the front camera has none"
        raise InputError(path, expected="poses in the metadata", found="none", advice=advice)
    return poses


def _stamps(metadata: dict[str, Any], numbers: list[int]) -> dict[int, float]:
    times, rate = metadata.get("frameTimestamps") or [], float(metadata.get("fps") or files.FRAME_RATE)
    return {n: float(times[n]) if n < len(times) else n / rate for n in numbers}


def _frame(
    path: Path,
    root: zipfile.Path,
    number: int,
    stamp: float,
    poses: npt.NDArray[np.float64],
    depth: Intrinsics,
    decompress: Decompress,
) -> RawFrame:
    where = f"{path}, frame {number}"

    def pose() -> npt.NDArray[np.float64]:
        if number >= len(poses):
            advice = "leave the frame out"
            raise BadFrameError(where, expected=f"a pose, {len(poses)} are there", found="no pose", advice=advice)
        row = poses[number]
        if not np.isfinite(row).all() or not 0.9 < np.linalg.norm(row[:4]) < 1.1:
            return np.full((4, 4), np.nan)
        return pose_from_quaternion(row[4:], row[:4]) @ OPENGL_CAMERA

    return RawFrame(
        where=where,
        pose_where=f"{path}, metadata, pose {number}",
        stamp=stamp,
        color=partial(files.read_color, root / "rgbd" / f"{number}.jpg"),
        depth=partial(_depth, root / "rgbd", number, depth, decompress),
        pose=pose,
    )


def _depth(folder: zipfile.Path, number: int, camera: Intrinsics, decompress: Decompress) -> npt.NDArray[np.float32]:
    file, confidence = folder / f"{number}.depth", folder / f"{number}.conf"
    depth, count = _floats(file, decompress), camera.width * camera.height
    if depth.size != count:
        found, advice = "a truncated or unreadable image", "export the recording again or leave the frame out"
        raise BadFrameError(str(file), expected=f"depth of {count} values", found=found, advice=advice)
    depth = depth.reshape(camera.height, camera.width).copy()
    if confidence.exists():
        sure = np.frombuffer(decompress(files.read_bytes(confidence)), np.uint8)
        if sure.size == count:
            depth[sure.reshape(depth.shape) == LOW_CONFIDENCE] = 0
    return depth


def _floats(file: zipfile.Path, decompress: Decompress) -> npt.NDArray[np.float32]:
    data = decompress(files.read_bytes(file))
    return np.frombuffer(data[: len(data) // 4 * 4], "<f4")
