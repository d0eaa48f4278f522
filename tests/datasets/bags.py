"""The rendered room written as ROS 1 and ROS 2 bags with the library that reads them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tests.datasets.scene import CAMERA, pose, quaternion, render
from uppm.core.geometry import invert, pose_from_quaternion
from uppm.core.types import Intrinsics

COUNT = 4
START = 1_700_000_000.0
OPTICAL = pose_from_quaternion([0.05, 0.02, 0.3], [-0.5, 0.5, -0.5, 0.5])
"""T_base_camera: the optical frame on the robot."""
T_MAP_ODOM = pose_from_quaternion([0.4, -0.3, 0.1], [0.0, 0.0, np.sin(0.2), np.cos(0.2)])
Message = tuple[str, str, float, Any]
"""Topic, type, time of recording, message."""


class Maker:
    """Messages of one of the library's type stores."""

    def __init__(self, *, ros1: bool) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.ros1 = ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        if ros1:
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))

    def __getattr__(self, name: str) -> Callable[..., Any]:
        package, _, kind = name.partition("__")
        return self.store.types[f"{package}/msg/{kind}"]

    def header(self, time: float, frame: str) -> Any:
        stamp = self.builtin_interfaces__Time(sec=int(time), nanosec=round((time - int(time)) * 1e9))
        extra = {"seq": 0} if self.ros1 else {}
        return self.std_msgs__Header(stamp=stamp, frame_id=frame, **extra)

    def transform(self, time: float, parent: str, child: str, T: np.ndarray) -> Any:
        place = self.geometry_msgs__Vector3(x=T[0, 3], y=T[1, 3], z=T[2, 3])
        turn = self.geometry_msgs__Quaternion(**dict(zip("xyzw", quaternion(T), strict=True)))
        inner = self.geometry_msgs__Transform(translation=place, rotation=turn)
        header = self.header(time, parent)
        return self.geometry_msgs__TransformStamped(header=header, child_frame_id=child, transform=inner)

    def posed(self, T: np.ndarray) -> Any:
        place = self.geometry_msgs__Point(x=T[0, 3], y=T[1, 3], z=T[2, 3])
        turn = self.geometry_msgs__Quaternion(**dict(zip("xyzw", quaternion(T), strict=True)))
        return self.geometry_msgs__Pose(position=place, orientation=turn)

    def image(self, time: float, frame: str, encoding: str, pixels: np.ndarray, pad: int = 0) -> Any:
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, pad)))
        return self.sensor_msgs__Image(
            header=self.header(time, frame), height=pixels.shape[0], width=pixels.shape[1], encoding=encoding,
            is_bigendian=0, step=rows.shape[1], data=rows.ravel(),
        )  # fmt: skip

    def compressed(self, time: float, frame: str, form: str, data: bytes) -> Any:
        return self.sensor_msgs__CompressedImage(
            header=self.header(time, frame), format=form, data=np.frombuffer(data, np.uint8)
        )

    def info(self, time: float, frame: str, camera: Intrinsics = CAMERA, D: Iterable[float] = (0.0,) * 5) -> Any:
        roi = self.sensor_msgs__RegionOfInterest(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        K, P = camera.matrix, np.column_stack([camera.matrix, np.zeros(3)])
        arrays = {"D": np.array(list(D)), "K": K.ravel(), "R": np.eye(3).ravel(), "P": P.ravel()}
        named = arrays if self.ros1 else {name.lower(): value for name, value in arrays.items()}
        return self.sensor_msgs__CameraInfo(
            header=self.header(time, frame), height=camera.height, width=camera.width, distortion_model="plumb_bob",
            binning_x=0, binning_y=0, roi=roi, **named,
        )  # fmt: skip

    def odometry(self, time: float, T: np.ndarray, child: str) -> Any:
        zero = self.geometry_msgs__Vector3(x=0.0, y=0.0, z=0.0)
        twist = self.geometry_msgs__TwistWithCovariance(
            twist=self.geometry_msgs__Twist(linear=zero, angular=zero), covariance=np.zeros(36)
        )
        posed = self.geometry_msgs__PoseWithCovariance(pose=self.posed(T), covariance=np.zeros(36))
        header = self.header(time, "odom")
        return self.nav_msgs__Odometry(header=header, child_frame_id=child, pose=posed, twist=twist)


def stamp(i: int) -> float:
    return START + i / 10


def png(image: np.ndarray, head: bytes = b"") -> bytes:
    return head + cv2.imencode(".png", image)[1].tobytes()


def color_messages(m: Maker, *, form: str = "rgb8") -> list[Message]:
    out: list[Message] = []
    for i in range(COUNT):
        color = render(pose(i))[0]
        if form == "compressed":
            message = m.compressed(stamp(i), "camera", "rgb8; png compressed bgr8", png(color[..., ::-1]))
            out.append(("/camera/color/image_raw/compressed", "sensor_msgs/msg/CompressedImage", stamp(i), message))
        else:
            stored = color[..., ::-1] if form == "bgr8" else color
            message = m.image(stamp(i), "camera", form, stored, pad=8)
            out.append(("/camera/color/image_raw", "sensor_msgs/msg/Image", stamp(i) + 0.01, message))
    return [("/camera/color/camera_info", "sensor_msgs/msg/CameraInfo", START, m.info(START, "camera")), *out]


def depth_messages(m: Maker, *, form: str = "16UC1", late: float = 0.004) -> list[Message]:
    """Depth of the colour camera, a little later than colour."""
    out: list[Message] = []
    for i in range(COUNT):
        depth, time = render(pose(i))[1], stamp(i) + late
        if form in ("16UC1", "32FC1"):
            stored = depth if form == "32FC1" else np.rint(depth * 1000).astype(np.uint16)
            message = m.image(time, "camera", form, stored)
            out.append(("/camera/depth/image_rect", "sensor_msgs/msg/Image", time, message))
            continue
        a, b = 100.0, 0.0
        stored = np.rint(a / depth * 100) if form.startswith("32FC1") else np.rint(depth * 1000)
        head = struct.pack("<iff", 0, a * 100, b)
        message = m.compressed(time, "camera", form, png(stored.astype(np.uint16), head))
        topic = "/camera/depth/image_rect/compressedDepth"
        out.append((topic, "sensor_msgs/msg/CompressedImage", time, message))
    info = m.info(START, "camera")
    return [("/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", START, info), *out]


def transform_messages(m: Maker) -> list[Message]:
    """map -> odom -> base_link moving, base_link -> camera fixed; the moving ones half-way between the images too."""
    kind = "tf2_msgs/msg/TFMessage"
    fixed = m.tf2_msgs__TFMessage(transforms=[m.transform(START, "base_link", "camera", OPTICAL)])
    out: list[Message] = [("/tf_static", kind, START, fixed)]
    for k in range(2 * COUNT + 1):
        time = START + (k - 1) / 20
        T_map_base = pose((k - 1) / 2) @ invert(OPTICAL)
        moves = [
            m.transform(time, "map", "odom", T_MAP_ODOM),
            m.transform(time, "odom", "base_link", invert(T_MAP_ODOM) @ T_map_base),
        ]
        out.append(("/tf", kind, time, m.tf2_msgs__TFMessage(transforms=moves)))
    return out


def write(path: Path, messages: Iterable[Message], *, ros1: bool = False, mcap: bool = False) -> Path:
    """A bag of these messages; of ROS 2, its folder."""
    store = Maker(ros1=ros1).store
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    with _writer(path, ros1=ros1, mcap=mcap) as bag:
        topics: dict[str, Any] = {}
        for topic, kind, time, message in sorted(messages, key=lambda each: each[2]):
            if topic not in topics:
                topics[topic] = bag.add_connection(topic, kind, typestore=store)
            bag.write(topics[topic], round(time * 1e9), serialize(message, kind))
    return path


def _writer(path: Path, *, ros1: bool, mcap: bool) -> Any:
    if ros1:
        from rosbags.rosbag1 import Writer

        return Writer(path)
    from rosbags.rosbag2 import StoragePlugin, Writer

    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    return Writer(path, version=9, storage_plugin=plugin)


def room(m: Maker, *, color: str = "rgb8", depth: str = "16UC1") -> list[Message]:
    """All that a map needs."""
    return [*color_messages(m, form=color), *depth_messages(m, form=depth), *transform_messages(m)]
