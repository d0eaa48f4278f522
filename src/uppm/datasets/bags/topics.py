"""Which topics of a recording hold what a map needs."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

from uppm.core.errors import InputError
from uppm.datasets.bags.recording import Recording

IMAGES = "sensor_msgs/Image", "sensor_msgs/CompressedImage"
CAMERA_INFO = "sensor_msgs/CameraInfo"
TRANSFORMS = "tf2_msgs/TFMessage", "tf/tfMessage"
POSES = (
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/TransformStamped",
    "nav_msgs/Odometry",
)
TRANSPORT = re.compile(r"/(compressed|compressedDepth|theora|zstd)$")
"""What image_transport appends to an image's topic."""


def depth_topic(recording: Recording, wanted: str | None) -> str:
    """The depth images' topic: the one named, or the best by its name; raises `InputError`."""
    candidates = [topic for topic in recording.of_type(*IMAGES) if "depth" in topic.lower()]
    return _chosen(recording, wanted, candidates, IMAGES, "depth", "input.depth_topic", _depth_rank)


def color_topic(recording: Recording, wanted: str | None) -> str:
    """The colour images' topic: the one named, or the best by its name; raises `InputError`."""
    others = "depth", "infra", "mask", "label", "segment", "/ir/"
    images = recording.of_type(*IMAGES)
    candidates = [topic for topic in images if not any(word in topic.lower() for word in others)]
    return _chosen(recording, wanted, candidates, IMAGES, "colour", "input.color_topic", _color_rank)


def info_topic(recording: Recording, images: str, setting: str, wanted: str | None) -> str:
    """The camera_info topic beside an image topic (as image_transport has it), or the one named."""
    base = TRANSPORT.sub("", images).rpartition("/")[0]
    beside = f"{base}/camera_info"
    candidates = [beside] if recording.topics.get(beside) == CAMERA_INFO else []
    if not candidates and not wanted:
        known = recording.of_type(CAMERA_INFO)
        found = f"camera_info only at {', '.join(known)}" if known else f"no camera_info; topics: {recording.listed()}"
        advice = f"record {beside}, or name the topic with --set {setting}=TOPIC"
        raise InputError(recording.path, expected=f"intrinsics of {images} at {beside}", found=found, advice=advice)
    return _chosen(recording, wanted, candidates, (CAMERA_INFO,), "camera_info", setting, len)


def pose_topic(recording: Recording, wanted: str | None) -> str | None:
    """The topic named for poses, None where poses are to come from /tf; raises `InputError`."""
    if wanted is None:
        return None
    return _chosen(recording, wanted, [], POSES, "pose", "input.pose_topic", len)


def _chosen(
    recording: Recording,
    wanted: str | None,
    candidates: Sequence[str],
    types: Sequence[str],
    what: str,
    setting: str,
    rank: Callable[[str], Any],
) -> str:
    if wanted:
        if recording.topics.get(wanted) in types:
            return wanted
        kind = recording.topics.get(wanted)
        found = f"{wanted} of type {kind}" if kind else f"no topic {wanted}; topics: {recording.listed()}"
        advice = f"name one of these with --set {setting}=TOPIC"
        raise InputError(recording.path, expected=f"a {what} topic of {' or '.join(types)}", found=found, advice=advice)
    if not candidates:
        found, advice = f"topics {recording.listed()}", f"record one, or name it with --set {setting}=TOPIC"
        raise InputError(recording.path, expected=f"a {what} topic of {' or '.join(types)}", found=found, advice=advice)
    best = sorted(candidates, key=rank)
    if len(best) > 1 and rank(best[0]) == rank(best[1]):
        found = f"several alike: {', '.join(t for t in best if rank(t) == rank(best[0]))}"
        advice = f"name one with --set {setting}=TOPIC"
        raise InputError(recording.path, expected=f"one {what} topic", found=found, advice=advice)
    return best[0]


def _depth_rank(topic: str) -> tuple[bool, bool, bool]:
    """Registered to colour first, then rectified, then as measured rather than compressed."""
    name = topic.lower()
    registered = "aligned" in name or "registered" in name
    return not registered, "rect" not in name, bool(TRANSPORT.search(topic))


def _color_rank(topic: str) -> tuple[bool, bool, bool]:
    """Named so first, then rectified, then as taken rather than compressed."""
    name = topic.lower()
    return not ("color" in name or "rgb" in name), "rect" not in name, bool(TRANSPORT.search(topic))
