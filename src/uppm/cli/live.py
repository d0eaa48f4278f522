"""`uppm live`: a camera that runs into a map file."""

from __future__ import annotations

from contextlib import suppress
from enum import Enum
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uppm.cli.view import WatchedRun

if TYPE_CHECKING:
    from uppm.core.config import InputConfig
    from uppm.datasets.streams.realsense import PoseAt, RealSenseStream
    from uppm.datasets.streams.record3d import Record3DStream
    from uppm.live import LiveStatistics


class Camera(str, Enum):
    """What `uppm live` can listen to."""

    RECORD3D = "record3d"
    REALSENSE = "realsense"


class FullQueue(str, Enum):
    """`LiveMapper`'s policies."""

    DROP_OLDEST = "drop-oldest"
    DROP_NEWEST = "drop-newest"
    BLOCK = "block"


def live(
    camera: Annotated[Camera, typer.Argument(help="record3d: an iPhone or iPad by USB; realsense.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Map file to write.", metavar="MAP.uppm")],
    poses: Annotated[Path | None, typer.Option(help="realsense: trajectory, time tx ty tz qx qy qz qw.")] = None,
    pose_topic: Annotated[str | None, typer.Option(help="realsense: ROS 2 topic of poses, instead of a file.")] = None,
    camera_on_body: Annotated[
        Path | None, typer.Option(help="realsense: 4x4 pose of the camera on what the poses are of.")
    ] = None,
    recording: Annotated[Path | None, typer.Option(help="realsense: a recording instead of a camera.")] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Stop after so many frames.")] = None,
    policy: Annotated[FullQueue, typer.Option(help="When the queue is full.")] = FullQueue.DROP_OLDEST,
    capacity: Annotated[int, typer.Option(min=1, help="Frames that wait at most.")] = 4,
    set_: Annotated[list[str] | None, typer.Option("--set", help="One setting, as perception.up=+y.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing map.")] = False,
    view: Annotated[bool, typer.Option("--view", help="Show the map in the browser while it is made.")] = False,
    view_host: Annotated[str, typer.Option(help="As `uppm view --host`.")] = "127.0.0.1",
    view_port: Annotated[int, typer.Option(min=0, max=65535, help="As `uppm view --port`.")] = 8080,
) -> None:
    """Map what a camera sees while it runs; Ctrl-C ends it and writes the map."""
    from uppm.core.config import Config
    from uppm.live import LiveMapper
    from uppm.map.store import check_free
    from uppm.perception.provision import provide
    from uppm.pipeline import Mapper

    config = Config.load(overrides=set_ or [])
    check_free(output, overwrite)
    provide(config.perception)
    if camera is Camera.RECORD3D:
        stream = record3d()
    else:
        stream = realsense(config.input, poses, pose_topic, camera_on_body, recording)
    watched = WatchedRun(view_host, view_port, None) if view else None
    running = Mapper(config, viewer=watched.viewer if watched else None)
    with (
        LiveMapper(running, capacity=capacity, policy=policy.value, output=output, overwrite=overwrite) as mapper,
        suppress(KeyboardInterrupt),
    ):
        for frame in islice(stream.frames(), frames):
            mapper.push(frame)
    without_pose = getattr(stream, "without_pose", 0)
    typer.echo(f"{output}: {said(mapper.statistics)}" + (f", {without_pose} without a pose" if without_pose else ""))
    if watched:
        watched.stay(output)


def record3d() -> Record3DStream:
    """The stream of the first device."""
    from uppm.datasets.streams.record3d import Record3DStream

    return Record3DStream()


def realsense(
    config: InputConfig, poses: Path | None, topic: str | None, camera_on_body: Path | None, recording: Path | None
) -> RealSenseStream:
    """The camera's stream, with poses of a file or a topic."""
    import numpy as np

    from uppm.core.errors import InputError
    from uppm.datasets.files import read_matrix
    from uppm.datasets.streams.poses import FilePoses, TopicPoses
    from uppm.datasets.streams.realsense import RealSenseStream

    if (poses is None) == (topic is None):
        found = "neither" if poses is None else "both"
        advice = "a RealSense knows no poses: name where they come from"
        raise InputError("realsense", expected="--poses or --pose-topic", found=found, advice=advice)
    T_body_camera = read_matrix(camera_on_body, 4) if camera_on_body else np.eye(4)
    pose_at: PoseAt
    if poses:
        pose_at = FilePoses(poses, config, T_body_camera)
    else:
        pose_at = TopicPoses(str(topic), config.time_tolerance, T_body_camera)
    return RealSenseStream(pose_at, recording=recording)


def said(s: LiveStatistics) -> str:
    """The counts for people."""
    return (
        f"{s.mapped} frames mapped, {s.skipped} skipped, {s.dropped} dropped; "
        f"latency {s.mean_latency:.2f} s, at most {s.max_latency:.2f} s"
    )
