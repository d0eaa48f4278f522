"""Images and camera models of ROS messages."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.errors import BadFrameError
from uppm.core.types import Intrinsics
from uppm.datasets import files

DEPTH_UNITS = {"16UC1": 1000.0, "mono16": 1000.0, "32FC1": 1.0}
"""Encoding -> units a metre (REP 118)."""
HEADER = 12
"""Bytes of compressedDepth before its PNG: the format, and the two numbers with which floats were quantised."""
PNG = b"\x89PNG"
PLAIN = {"rgb8": slice(None), "bgr8": slice(None, None, -1)}
"""Encoding -> order of its channels as RGB; others need a library."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraModel:
    """A camera of a camera_info message: pinhole intrinsics, and the maps that take lens distortion out."""

    intrinsics: Intrinsics
    maps: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]] | None
    """None: the images are free of distortion."""

    def undistorted(self, image: npt.NDArray[Any], *, nearest: bool) -> npt.NDArray[Any]:
        """The image (H, W, ...) as the pinhole camera would have seen it; depth must not be interpolated."""
        if self.maps is None or image.shape[:2] != self.maps[0].shape:
            return image
        return cv2.remap(image, *self.maps, cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR)


def camera_model(info: Any, *, rectified: bool) -> CameraModel | None:
    """Camera of a sensor_msgs/CameraInfo; None where its distortion model is not known.

    rectified: the topic holds images that a rectifier has made, for which the projection matrix counts (REP 104).
    """
    K = np.asarray(info.k if hasattr(info, "k") else info.K, dtype=np.float64).reshape(3, 3)
    P = np.asarray(info.p if hasattr(info, "p") else info.P, dtype=np.float64).reshape(3, 4)
    D = np.asarray(info.d if hasattr(info, "d") else info.D, dtype=np.float64)
    if rectified and P[0, 0] > 0:
        K, D = P[:, :3], np.zeros(0)
    size = int(info.width), int(info.height)
    intrinsics = Intrinsics(fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2], width=size[0], height=size[1])
    if not D.any():
        return CameraModel(intrinsics=intrinsics, maps=None)
    if info.distortion_model in ("plumb_bob", "rational_polynomial"):
        maps = cv2.initUndistortRectifyMap(K, D, np.eye(3), K, size, cv2.CV_32FC1)
    elif info.distortion_model == "equidistant":
        maps = cv2.fisheye.initUndistortRectifyMap(K, D[:4], np.eye(3), K, size, cv2.CV_32FC1)
    else:
        return None
    return CameraModel(intrinsics=intrinsics, maps=(maps[0].astype(np.float32), maps[1].astype(np.float32)))


def color_image(message: Any, where: str) -> npt.NDArray[np.uint8]:
    """(H, W, 3) RGB of a sensor_msgs Image or CompressedImage."""
    if hasattr(message, "format"):
        return files.decode_color(bytes(message.data), where)
    row = 3 * message.width
    if message.encoding in PLAIN and len(message.data) >= row * message.height > 0:
        rows = np.asarray(message.data, dtype=np.uint8).reshape(message.height, -1)[:, :row]
        return np.ascontiguousarray(rows.reshape(message.height, message.width, 3)[..., PLAIN[message.encoding]])
    from rosbags.image import ImageError, message_to_cvimage

    try:
        image = message_to_cvimage(_tight(message), "rgb8")
    except (ImageError, cv2.error, ValueError, TypeError):
        found = f"one that cannot be decoded ({message.encoding})"
        advice = "record rgb8 or bgr8, or compressed"
        raise BadFrameError(where, expected="a colour image", found=found, advice=advice) from None
    return np.ascontiguousarray(image, dtype=np.uint8)


def depth_image(message: Any, where: str) -> npt.NDArray[np.generic]:
    """(H, W) depth in the message's own units: 16UC1, 32FC1, or compressedDepth of either; 0: invalid."""
    depth = _compressed_depth(message) if hasattr(message, "format") else _raw_depth(message)
    if depth is None or depth.ndim != 2:
        found = f"one that cannot be decoded ({_kind(message)})"
        raise BadFrameError(
            where,
            expected="a depth image",
            found=found,
            advice="record 16UC1 or 32FC1, raw or as PNG (compressedDepth)",
        )
    return depth


def depth_units(message: Any) -> float | None:
    """Units a metre of a depth message; None where its encoding is not one of depth."""
    encoding = message.format.split(";")[0].strip() if hasattr(message, "format") else message.encoding
    return DEPTH_UNITS.get(encoding)


def _kind(message: Any) -> str:
    return message.format if hasattr(message, "format") else message.encoding


def _tight(message: Any) -> Any:
    """An image message whose rows stand one after the other, without padding."""
    row = len(message.data) // max(message.height, 1)
    used = row // max(message.width, 1) * message.width
    if row == used:
        return message
    message.data = np.asarray(message.data).reshape(message.height, row)[:, :used].ravel()
    return message


def _raw_depth(message: Any) -> npt.NDArray[np.generic] | None:
    kinds = {"16UC1": np.uint16, "mono16": np.uint16, "32FC1": np.float32}
    if message.encoding not in kinds:
        return None
    dtype = np.dtype(kinds[message.encoding]).newbyteorder(">" if message.is_bigendian else "<")
    rows = np.asarray(message.data, dtype=np.uint8).reshape(message.height, -1)
    row = message.width * dtype.itemsize
    if rows.shape[1] < row:
        return None
    return np.ascontiguousarray(rows[:, :row]).view(dtype).astype(dtype.newbyteorder("="))


def _compressed_depth(message: Any) -> npt.NDArray[np.generic] | None:
    """Depth of ROS's compressed_depth_image_transport, PNG; floats are stored as a / depth + b."""
    data = bytes(message.data)
    start = HEADER if data[HEADER : HEADER + 4] == PNG else 0
    if data[start : start + 4] != PNG:
        return None
    stored = cv2.imdecode(np.frombuffer(data, np.uint8, offset=start), cv2.IMREAD_UNCHANGED)
    if stored is None or depth_units(message) != 1.0:
        return stored
    _, a, b = struct.unpack("<iff", data[:HEADER])
    inverse = stored.astype(np.float32) - np.float32(b)
    return np.where(stored > 0, np.float32(a) / np.where(inverse == 0, np.float32(np.inf), inverse), np.float32(0))
