"""Poses for a camera that knows none: of a trajectory file, or of a ROS 2 topic."""

from __future__ import annotations

from collections import deque
from importlib import import_module
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import InputError, MissingExtraError
from uppm.core.validation import check_pose
from uppm.datasets.bags.recording import seconds
from uppm.datasets.bags.topics import POSES
from uppm.datasets.bags.transforms import NoTransformError, pose_of, track
from uppm.datasets.poses import pose_matrix
from uppm.datasets.trajectory import read_trajectory

Pose = npt.NDArray[np.float64]
DISCOVERY, PATIENCE = 5.0, 0.5
"""Seconds that a topic may take to be found, and a pose to come."""
KEPT = 200


class FilePoses:
    """Poses of a file with `time tx ty tz qx qy qz qw` a line, interpolated.

    Parameters
    ----------
    config : InputConfig
        Conventions of the poses, and the tolerance at the ends.
    T_body_camera : (4, 4)
        The camera on what the poses are of.
    """

    def __init__(self, path: Path, config: InputConfig, T_body_camera: Pose) -> None:
        times, rows = read_trajectory(path)
        poses = [pose_matrix(row, str(path), config) for row in rows]
        for pose in poses:
            check_pose(str(path), pose)
        self._track = track(list(zip(times.tolist(), poses, strict=True)))
        self._tolerance, self._T_body_camera = config.time_tolerance, T_body_camera

    def __call__(self, time: float) -> Pose | None:
        """T_map_camera at a time in seconds; None outside the file's times."""
        try:
            return self._track.at(time, self._tolerance) @ self._T_body_camera
        except NoTransformError:
            return None


class TopicPoses:
    """Poses of a ROS 2 topic: PoseStamped, PoseWithCovarianceStamped, TransformStamped or Odometry.

    Raises
    ------
    MissingExtraError
        There is no rclpy in this Python.
    InputError
        No such topic is there, or it has another type.
    """

    def __init__(self, topic: str, tolerance: float, T_body_camera: Pose) -> None:
        try:
            self._rclpy: Any = import_module("rclpy")
        except ImportError:
            command = "source /opt/ros/DISTRIBUTION/setup.bash"
            raise MissingExtraError("rclpy, which listens to a topic,", command) from None
        self._tolerance, self._T_body_camera = tolerance, T_body_camera
        self._samples: deque[tuple[float, Pose]] = deque(maxlen=KEPT)
        if not self._rclpy.ok():
            self._rclpy.init()
        self._node = self._rclpy.create_node("uppm_poses")
        package, _, name = self._type(topic).partition("/")
        kind = getattr(import_module(f"{package}.msg"), name)
        self._node.create_subscription(kind, topic, self._take, 10)

    def _type(self, topic: str) -> str:
        end, known = monotonic() + DISCOVERY, {}
        while topic not in known and monotonic() < end:
            self._rclpy.spin_once(self._node, timeout_sec=0.1)
            known = {name: kinds[0].replace("/msg/", "/") for name, kinds in self._node.get_topic_names_and_types()}
        if known.get(topic) not in POSES:
            found = f"one of {known[topic]}" if topic in known else f"topics {', '.join(sorted(known)) or 'none'}"
            advice = "name a topic of poses with --pose-topic"
            raise InputError(topic, expected=f"a topic of {' or '.join(POSES)}", found=found, advice=advice)
        return known[topic]

    def _take(self, message: Any) -> None:
        inner = message.transform if hasattr(message, "transform") else message.pose
        self._samples.append((seconds(message.header.stamp), pose_of(inner.pose if hasattr(inner, "pose") else inner)))

    def __call__(self, time: float) -> Pose | None:
        """T_map_camera at a time in seconds, waiting a little for it; None where it is not told."""
        end = monotonic() + PATIENCE
        while (not self._samples or self._samples[-1][0] < time) and monotonic() < end:
            self._rclpy.spin_once(self._node, timeout_sec=0.05)
        if not self._samples:
            return None
        try:
            return track(list(self._samples)).at(time, self._tolerance) @ self._T_body_camera
        except NoTransformError:
            return None
