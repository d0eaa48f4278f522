"""A posed sequence as a ROS 2 bag, with the topics and frames that a robot with a depth camera records."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from uppm.core.errors import BadFrameError, InputError, MissingExtraError
from uppm.core.folders import whole_folder
from uppm.core.geometry import invert, pose_from_quaternion
from uppm.core.protocols import FrameSource
from uppm.core.types import Frame, Intrinsics
from uppm.datasets.bags.recording import COMMAND

CAMERA, BASE, MAP = "camera_color_optical_frame", "base_link", "map"
T_BASE_CAMERA = pose_from_quaternion([0.2, 0.0, 0.5], [-0.5, 0.5, -0.5, 0.5])
"""Where the camera looks ahead, with optical axes (REP 103), on a base with x forward and z up."""
COLOR, DEPTH = "/camera/color", "/camera/aligned_depth_to_color"
MAX_MILLIMETRES = 65535
JPEG_QUALITY = 95

Message = tuple[str, str, Any]
"""Topic, type, message."""


def write_bag(source: FrameSource, output: Path) -> int:
    """Write a sequence as a ROS 2 bag's folder (MCAP), whole or not at all; returns the count of frames.

    Colour is JPEG, depth 16UC1 in millimetres, poses are transforms map -> base_link on /tf, the camera is fixed to the
    base on /tf_static. Frames that cannot be used are left out.

    Raises
    ------
    InputError
        The folder exists, or no frame can be used.
    MissingExtraError
        `rosbags` is not installed.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError("rosbags, which writes bags,", COMMAND) from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    with whole_folder(output) as folder:
        # The library makes its folder itself, and names the file after it.
        inner = folder / output.name
        with Writer(inner, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
            count = _write(source, bag, store)
        for file in list(inner.iterdir()):
            file.rename(folder / file.name)
        inner.rmdir()
    return count


def _write(source: FrameSource, bag: Any, store: Any) -> int:
    """Count of the frames written."""
    messages, topics, count = _Messages(store.types), dict[str, Any](), 0
    for position in range(len(source)):
        with suppress(BadFrameError):
            frame = source.frame(position)
            for topic, kind, message in messages.of_frame(frame, first=not count):
                if topic not in topics:
                    topics[topic] = bag.add_connection(topic, kind, typestore=store)
                bag.write(topics[topic], round(frame.stamp * 1e9), store.serialize_cdr(message, kind))
            count += 1
    if not count:
        advice = "see what `uppm check` says of the sequence"
        raise InputError(source.name, expected="frames that can be used", found="none", advice=advice)
    return count


class _Messages:
    """Messages of one type store."""

    def __init__(self, types: dict[str, Any]) -> None:
        self._types = types

    def of_frame(self, frame: Frame, *, first: bool) -> Iterator[Message]:
        """All that is recorded at a frame's time; the fixed transform with the first."""
        header = self._header(frame.stamp, CAMERA)
        info = self._camera_info(header, frame.intrinsics)
        if first:
            yield "/tf_static", *self._transform(frame.stamp, BASE, CAMERA, T_BASE_CAMERA)
        yield "/tf", *self._transform(frame.stamp, MAP, BASE, frame.T_map_camera @ invert(T_BASE_CAMERA))
        for prefix in (COLOR, DEPTH):
            yield f"{prefix}/camera_info", "sensor_msgs/msg/CameraInfo", info
        encoded = cv2.imencode(".jpg", frame.color[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        kind = "sensor_msgs/msg/CompressedImage"
        picture = self._types[kind](header=header, format="rgb8; jpeg compressed bgr8", data=encoded.ravel())
        yield f"{COLOR}/image_raw/compressed", kind, picture
        depth = np.rint(frame.depth * 1000).clip(0, MAX_MILLIMETRES).astype("<u2")
        height, width = depth.shape
        kind = "sensor_msgs/msg/Image"
        yield f"{DEPTH}/image_raw", kind, self._types[kind](
            header=header, height=height, width=width, encoding="16UC1", is_bigendian=0, step=2 * width,
            data=depth.view(np.uint8).ravel(),
        )  # fmt: skip

    def _header(self, stamp: float, frame: str) -> Any:
        seconds, nano = divmod(round(stamp * 1e9), 10**9)
        time = self._types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nano)
        return self._types["std_msgs/msg/Header"](stamp=time, frame_id=frame)

    def _camera_info(self, header: Any, camera: Intrinsics) -> Any:
        roi = self._types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        K = camera.matrix
        return self._types["sensor_msgs/msg/CameraInfo"](
            header=header, height=camera.height, width=camera.width, distortion_model="plumb_bob", d=np.zeros(5),
            k=K.ravel(), r=np.eye(3).ravel(), p=np.column_stack([K, np.zeros(3)]).ravel(), binning_x=0, binning_y=0,
            roi=roi,
        )  # fmt: skip

    def _transform(self, stamp: float, parent: str, child: str, T: npt.NDArray[np.float64]) -> tuple[str, Any]:
        geometry = "geometry_msgs/msg/"
        place = self._types[geometry + "Vector3"](**dict(zip("xyz", T[:3, 3].tolist(), strict=True)))
        turn = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
        inner = self._types[geometry + "Transform"](
            translation=place, rotation=self._types[geometry + "Quaternion"](**dict(zip("xyzw", turn, strict=True)))
        )
        stamped = self._types[geometry + "TransformStamped"](
            header=self._header(stamp, parent), child_frame_id=child, transform=inner
        )
        kind = "tf2_msgs/msg/TFMessage"
        return kind, self._types[kind](transforms=[stamped])
