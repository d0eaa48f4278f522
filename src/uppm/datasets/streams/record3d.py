"""Record3D's stream over USB: colour, LiDAR depth and ARKit's pose of each frame."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Event
from typing import Any

import numpy as np

from uppm.core.errors import InputError, MissingExtraError
from uppm.core.geometry import pose_from_quaternion
from uppm.core.types import Frame, Intrinsics
from uppm.datasets.poses import OPENGL_CAMERA
from uppm.datasets.record3d import LOW_CONFIDENCE, at_size
from uppm.datasets.registration import register_depth

LIDAR = 1
"""The stream's device type with poses; the front camera has none."""
PATIENCE = 5.0
"""Seconds without a frame after which the stream has ended."""


class Record3DStream:
    """Frames of the first iPhone or iPad that streams from the app.

    Raises
    ------
    MissingExtraError
        `record3d` is not installed.
    InputError
        No device is connected, it does not stream, or it streams from its front camera.
    """

    def __init__(self) -> None:
        try:
            from record3d import Record3DStream as Stream  # pyright: ignore[reportMissingImports]
        except ImportError:
            command = "pip install uppm[record3d-live]"
            raise MissingExtraError("record3d, which receives the app's stream,", command) from None
        devices = Stream.get_connected_devices()
        advice = "connect it by USB, choose USB streaming in Record3D's settings and press record"
        if not devices:
            raise InputError("Record3D", expected="an iPhone or iPad that streams", found="none", advice=advice)
        self._stream, self._came, self._stopped = Stream(), Event(), False
        self._stream.on_new_frame = self._came.set
        self._stream.on_stream_stopped = self._stop
        if not self._stream.connect(devices[0]):
            raise InputError("Record3D", expected="a device that streams", found="one that does not", advice=advice)

    def _stop(self) -> None:
        self._stopped = True
        self._came.set()

    def frames(self) -> Iterator[Frame]:
        """Frames until the app stops or nothing came for five seconds; what comes meanwhile is passed over."""
        index = 0
        try:
            while self._came.wait(PATIENCE) and not self._stopped:
                self._came.clear()
                yield self._frame(self._stream, index)
                index += 1
        finally:
            self._stream.disconnect()

    @staticmethod
    def _frame(stream: Any, index: int) -> Frame:
        if stream.get_device_type() != LIDAR:
            advice = "choose the LiDAR camera in the app"
            raise InputError("Record3D", expected="poses", found="the front camera, which has none", advice=advice)
        color = np.ascontiguousarray(stream.get_rgb_frame(), dtype=np.uint8)
        depth = np.array(stream.get_depth_frame(), dtype=np.float32)
        confidence = np.asarray(stream.get_confidence_frame())
        if confidence.shape == depth.shape:
            depth[confidence == LOW_CONFIDENCE] = 0
        depth[~np.isfinite(depth)] = 0
        K, height, width = stream.get_intrinsic_mat(), *color.shape[:2]
        camera = Intrinsics(fx=K.fx, fy=K.fy, cx=K.tx, cy=K.ty, width=width, height=height)
        own = at_size(camera, depth.shape[1], depth.shape[0])
        p = stream.get_camera_pose()
        return Frame(
            index=index,
            stamp=index / 30,
            color=color,
            depth=register_depth(depth, own.matrix, camera.matrix, np.eye(4), (width, height)),
            T_map_camera=pose_from_quaternion([p.tx, p.ty, p.tz], [p.qx, p.qy, p.qz, p.qw]) @ OPENGL_CAMERA,
            intrinsics=camera,
        )
