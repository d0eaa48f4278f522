"""A bag as a posed RGB-D sequence: frames by the colour images' times, poses from /tf or a topic."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError, InputError
from uppm.datasets.bags import topics
from uppm.datasets.bags.images import CameraModel, camera_model, color_image, depth_image, depth_units
from uppm.datasets.bags.recording import Entry, Recording, seconds
from uppm.datasets.bags.transforms import NoTransformError, Track, TransformTree, pose_of, track
from uppm.datasets.sequence import RawFrame, RawSequence
from uppm.datasets.times import nearest

MAP_FRAMES = "map", "world", "odom"
"""Fixed frames by rank, where none is named (REP 105)."""
SUFFIXES = ".bag", ".mcap", ".db3"

Pose = npt.NDArray[np.float64]
PoseAt = Callable[[float], Pose]


class Bag:
    looks_for = "a ROS bag: .bag, .mcap, .db3 or a ROS 2 bag's folder with metadata.yaml"

    @staticmethod
    def matches(path: Path) -> bool:
        return path.suffix in SUFFIXES or (path / "metadata.yaml").exists()

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        recording = Recording(path)
        color = _images(recording, topics.color_topic(recording, config.color_topic), "input.color_info_topic", config)
        depth = _images(recording, topics.depth_topic(recording, config.depth_topic), "input.depth_info_topic", config)
        tree = _tree(recording)
        pose_at = _poses(recording, tree, color.frame_id, config)
        frames = _frames(recording, color, depth, pose_at, config.time_tolerance)
        units = depth_units(recording.read(depth.entries[0]))
        if units is None:
            advice = "record 16UC1 or 32FC1, or name another topic with --set input.depth_topic=TOPIC"
            found = "images of another encoding"
            raise InputError(path, expected=f"depth images at {depth.topic}", found=found, advice=advice)
        return RawSequence(
            format="bag",
            name=path.resolve().name,
            frames=frames,
            color=color.camera.intrinsics,
            depth=depth.camera.intrinsics,
            T_color_depth=_extrinsics(path, tree, color, depth),
            depth_scale=units,
            intrinsics_source=color.info,
        )


@dataclass(frozen=True, kw_only=True)
class _Images:
    """One camera's images."""

    topic: str
    info: str
    """Topic of its camera_info."""
    entries: Sequence[Entry]
    camera: CameraModel

    @property
    def frame_id(self) -> str:
        return self.entries[0].frame_id


def _images(recording: Recording, topic: str, setting: str, config: InputConfig) -> _Images:
    wanted = config.color_info_topic if setting == "input.color_info_topic" else config.depth_info_topic
    info = topics.info_topic(recording, topic, setting, wanted)
    entries = recording.entries(topic)
    if not entries:
        advice = "record it again, or name another topic"
        raise InputError(recording.path, expected=f"images at {topic}", found="none", advice=advice)
    first = next((message for _, message in recording.messages(info)), None)
    camera = camera_model(first, rectified="rect" in topic.lower()) if first else None
    if camera is None:
        found = f"the model {first.distortion_model!r}" if first else "no message"
        advice = "record rectified images (image_proc), or name their topics"
        raise InputError(recording.path, expected=f"a pinhole camera at {info}", found=found, advice=advice)
    return _Images(topic=topic, info=info, entries=entries, camera=camera)


def _tree(recording: Recording) -> TransformTree:
    tree = TransformTree()
    for topic in recording.of_type(*topics.TRANSFORMS):
        for _, message in recording.messages(topic):
            for each in message.transforms:
                pose, fixed = pose_of(each.transform), topic.endswith("tf_static")
                tree.add(each.header.frame_id, each.child_frame_id, seconds(each.header.stamp), pose, fixed=fixed)
    return tree


def _poses(recording: Recording, tree: TransformTree, camera: str, config: InputConfig) -> PoseAt:
    """T_map_camera by time; raises `InputError` where the bag cannot tell."""
    topic = topics.pose_topic(recording, config.pose_topic)
    if topic:
        return _topic_poses(recording, topic, tree, camera, config)
    chain = tree.ancestors(camera)
    ranked = [frame for frame in MAP_FRAMES if frame in chain] or chain[-1:]
    target = config.map_frame or ranked[0]
    known = f"transforms of {', '.join(tree.frames)}" if tree.frames else "no /tf or /tf_static message"
    where = f"--set input.pose_topic=TOPIC, one of {', '.join(recording.of_type(*topics.POSES)) or 'none so far'}"
    if target not in chain:
        advice = f"name a frame above it with --set input.map_frame=FRAME, or a pose topic with {where}"
        expected = f"a chain of transforms from {target!r} to the colour camera's frame {camera!r}"
        raise InputError(recording.path, expected=expected, found=known, advice=advice)
    if not tree.moves(camera, target):
        expected = f"a moving transform above the colour camera's frame {camera!r}"
        advice = f"record /tf while the robot localises, or name a pose topic with {where}"
        raise InputError(recording.path, expected=expected, found=known, advice=advice)
    return lambda time: tree.lookup(target, camera, time, config.time_tolerance)


def _topic_poses(recording: Recording, topic: str, tree: TransformTree, camera: str, config: InputConfig) -> PoseAt:
    """Poses of a topic; of the frame that the message, or `input.pose_frame`, names, else of the camera itself."""
    samples, child = [], config.pose_frame
    for _, message in recording.messages(topic):
        inner = message.transform if hasattr(message, "transform") else message.pose
        samples.append((seconds(message.header.stamp), pose_of(inner.pose if hasattr(inner, "pose") else inner)))
        child = child or getattr(message, "child_frame_id", "").lstrip("/")
    if not samples:
        raise InputError(recording.path, expected=f"poses at {topic}", found="no message", advice="record it again")
    motion: Track = track(samples)
    if not child or child == camera:
        return lambda time: motion.at(time, config.time_tolerance)
    if camera not in tree.frames or not set(tree.ancestors(camera)) & set(tree.ancestors(child)):
        expected = f"transforms from {child!r}, whose poses {topic} tells, to the colour camera's frame {camera!r}"
        found = f"transforms of {', '.join(tree.frames)}" if tree.frames else "no /tf or /tf_static message"
        advice = f"record /tf_static, or say with --set input.pose_frame={camera} that the poses are the camera's"
        raise InputError(recording.path, expected=expected, found=found, advice=advice)
    tolerance = config.time_tolerance
    return lambda time: motion.at(time, tolerance) @ tree.lookup(child, camera, time, tolerance)


def _frames(recording: Recording, color: _Images, depth: _Images, pose_at: PoseAt, tolerance: float) -> list[RawFrame]:
    """One frame a colour image that has a depth image near in time."""
    times = np.array([entry.stamp for entry in color.entries])
    of_depth = nearest(times, np.array([entry.stamp for entry in depth.entries]), tolerance)
    if (of_depth < 0).all():
        gap = float(np.abs(times[:, None] - [entry.stamp for entry in depth.entries[:1000]]).min())
        found = f"none, the nearest pair {gap:.3f} s apart"
        advice = "raise it with --set input.time_tolerance=SECONDS, or name topics of one clock"
        expected = f"{color.topic} and {depth.topic} within {tolerance} s of each other"
        raise InputError(recording.path, expected=expected, found=found, advice=advice)
    order = np.argsort(times, kind="stable")
    pairs = [(color.entries[i], depth.entries[int(of_depth[i])]) for i in order.tolist() if of_depth[i] >= 0]
    return [_frame(recording, color, depth, pair, pose_at) for pair in pairs]


def _frame(
    recording: Recording, color: _Images, depth: _Images, pair: tuple[Entry, Entry], pose_at: PoseAt
) -> RawFrame:
    where = f"{recording.path}, {color.topic} at {pair[0].stamp:.6f} s"

    def pose() -> Pose:
        try:
            return pose_at(pair[0].stamp)
        except NoTransformError as error:
            found = f"none: {error}"
            raise BadFrameError(where, expected="a pose", found=found, advice="leave the frame out") from None

    return RawFrame(
        where=where,
        pose_where=f"{where}, pose",
        stamp=pair[0].stamp,
        color=lambda: color.camera.undistorted(color_image(recording.read(pair[0]), where), nearest=False),
        depth=lambda: depth.camera.undistorted(depth_image(recording.read(pair[1]), where), nearest=True),
        pose=pose,
    )


def _extrinsics(path: Path, tree: TransformTree, color: _Images, depth: _Images) -> Pose | None:
    """T_color_depth, None where depth is registered to colour."""
    same = color.camera.intrinsics == depth.camera.intrinsics
    if color.frame_id == depth.frame_id and same:
        return None
    if color.frame_id == depth.frame_id:
        return np.eye(4)
    try:
        return tree.lookup(color.frame_id, depth.frame_id, color.entries[0].stamp, np.inf)
    except NoTransformError as error:
        if same:
            return None
        expected = f"a transform from the depth camera {depth.frame_id!r} to the colour camera {color.frame_id!r}"
        advice = "record /tf_static, or depth registered to colour"
        raise InputError(path, expected=expected, found=str(error), advice=advice) from None
