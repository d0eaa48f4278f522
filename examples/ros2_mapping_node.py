"""A ROS 2 node that maps what a robot's depth camera sees: colour, aligned depth and /tf in, a map file out.

    python3 ros2_mapping_node.py --ros-args -p output:=run.uppm -p map_frame:=map

Stop it with Ctrl-C: what was mapped is written. It needs rclpy, sensor_msgs, tf2_msgs and uppm in one Python.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import rclpy  # pyright: ignore[reportMissingImports]
from rclpy.executors import ExternalShutdownException  # pyright: ignore[reportMissingImports]
from rclpy.node import Node  # pyright: ignore[reportMissingImports]
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data  # pyright: ignore[reportMissingImports]
from sensor_msgs.msg import CameraInfo, CompressedImage, Image  # pyright: ignore[reportMissingImports]
from tf2_msgs.msg import TFMessage  # pyright: ignore[reportMissingImports]

import uppm
from uppm.datasets.bags.images import CameraModel, camera_model, color_image, depth_image, depth_units
from uppm.datasets.bags.recording import seconds
from uppm.datasets.bags.transforms import NoTransformError, TransformTree, pose_of

PARAMETERS = {
    "color": "/camera/color/image_raw",
    "depth": "/camera/aligned_depth_to_color/image_raw",
    "camera_info": "/camera/color/camera_info",
    "map_frame": "map",
    "output": "run.uppm",
    "up": "+z",
    "policy": "drop-oldest",
    "capacity": 4,
    "tolerance": 0.02,
    "patience": 1.0,
}
"""`color` may end in /compressed; `tolerance`: seconds between colour, depth and pose; `patience`: seconds for which an
image waits for its transform."""
KEPT = 10.0
"""Seconds of /tf that are kept."""
KEPT_IMAGES = 30


class MappingNode(Node):
    """Pairs colour and depth by time, waits for the pose of that time, and pushes the frame."""

    def __init__(self) -> None:
        super().__init__("uppm_mapping")
        self._set = {name: self.declare_parameter(name, value).value for name, value in PARAMETERS.items()}
        config = uppm.Config.load(overrides=[f"perception.up={self._set['up']}"])
        self.live = uppm.LiveMapper(
            uppm.Mapper(config),
            capacity=self._set["capacity"],
            policy=self._set["policy"],
            output=self._set["output"],
        )
        self.without_pose = self.without_color = self._pushed = 0
        self._camera: CameraModel | None = None
        self._tree = TransformTree()
        self._colors: deque[Any] = deque(maxlen=KEPT_IMAGES)
        self._pairs: deque[tuple[Any, Any]] = deque()
        self._depths: deque[Any] = deque(maxlen=KEPT_IMAGES)
        color = CompressedImage if self._set["color"].endswith("/compressed") else Image
        self.create_subscription(color, self._set["color"], self.on_color, qos_profile_sensor_data)
        self.create_subscription(Image, self._set["depth"], self.on_depth, qos_profile_sensor_data)
        self.create_subscription(CameraInfo, self._set["camera_info"], self.on_camera_info, qos_profile_sensor_data)
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(TFMessage, "/tf_static", lambda message: self.on_transforms(message, True), latched)
        self.create_subscription(TFMessage, "/tf", lambda message: self.on_transforms(message, False), 100)
        self.create_timer(5.0, self.report)

    def on_camera_info(self, message: Any) -> None:
        """Take the first camera model; it holds for the whole run."""
        if self._camera is None:
            self._camera = camera_model(message, rectified="rect" in self._set["color"])
            if self._camera is None:
                found, advice = repr(message.distortion_model), "publish rectified images (image_proc)"
                raise uppm.InputError(self._set["camera_info"], expected="a pinhole camera", found=found, advice=advice)

    def on_transforms(self, message: Any, fixed: bool) -> None:
        """Take transforms, and push what waited for them."""
        for each in message.transforms:
            time = seconds(each.header.stamp)
            self._tree.add(each.header.frame_id, each.child_frame_id, time, pose_of(each.transform), fixed=fixed)
            if not fixed:
                self._tree.forget(each.child_frame_id, before=time - KEPT)
        self._push_ready()

    def on_color(self, message: Any) -> None:
        """Keep an image until its depth is there."""
        self._colors.append(message)
        self._pair()

    def on_depth(self, message: Any) -> None:
        """Keep a depth image until its colour is there."""
        self._depths.append(message)
        self._pair()

    def _pair(self) -> None:
        """Match each depth image with the colour nearest in time; one that comes before its colour waits for it."""
        while self._depths and self._colors:
            depth = self._depths[0]
            time, newest = seconds(depth.header.stamp), seconds(self._colors[-1].header.stamp)
            color = min(self._colors, key=lambda each: abs(seconds(each.header.stamp) - time))
            if abs(seconds(color.header.stamp) - time) <= self._set["tolerance"]:
                self._pairs.append((color, depth))
            elif newest <= time:
                return
            else:
                self.without_color += 1
            self._depths.popleft()
            self._push_ready()

    def _push_ready(self) -> None:
        while self._pairs and self._camera is not None:
            color, depth = self._pairs[0]
            time, newest = seconds(color.header.stamp), seconds((self._colors or [color])[-1].header.stamp)
            frame_id, tolerance = color.header.frame_id.lstrip("/"), self._set["tolerance"]
            try:
                pose = self._tree.lookup(self._set["map_frame"], frame_id, time, tolerance)
            except NoTransformError:
                if newest - time < self._set["patience"]:
                    return
                self.without_pose += 1
            else:
                self.live.push(self._frame(self._camera, time, pose, color, depth))
                self._pushed += 1
            self._pairs.popleft()

    def _frame(self, camera: CameraModel, time: float, pose: np.ndarray, color: Any, depth: Any) -> uppm.Frame:
        where, units = f"{self._set['depth']} at {time:.3f} s", depth_units(depth)
        measured = depth_image(depth, where)
        size = camera.intrinsics.height, camera.intrinsics.width
        if units is None or measured.shape != size:
            found = f"{measured.shape[1]}x{measured.shape[0]} of {depth.encoding}"
            advice = "subscribe to depth that is aligned to colour"
            raise uppm.InputError(where, expected=f"depth of {size[1]}x{size[0]}", found=found, advice=advice)
        metres = camera.undistorted(measured, nearest=True).astype(np.float32) / np.float32(units)
        metres[~np.isfinite(metres)] = 0
        return uppm.Frame(
            index=self._pushed,
            stamp=time,
            color=camera.undistorted(color_image(color, where), nearest=False),
            depth=metres,
            T_map_camera=pose,
            intrinsics=camera.intrinsics,
        )

    def report(self) -> None:
        """Log what became of the frames."""
        s = self.live.statistics
        lost = f"{self.without_color} depth images without colour, {self.without_pose} without a pose"
        self.get_logger().info(
            f"{s.mapped} frames mapped, {s.skipped} skipped, {s.dropped} dropped, {s.waiting} waiting, "
            f"{s.latency:.2f} s behind; {lost}"
        )


def main() -> None:
    """Run until the node is stopped, then write the map."""
    rclpy.init()
    node = MappingNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        node.get_logger().info("writing the map")
    finally:
        node.live.close()
        node.report()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
