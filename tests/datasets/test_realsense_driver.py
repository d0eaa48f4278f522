"""The driver itself, without a camera: its software device records the rendered room, which is played and mapped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uppm
from tests.datasets.scene import CAMERA, pose, render
from uppm.datasets.streams.realsense import RealSenseStream

rs: Any = pytest.importorskip("pyrealsense2", reason="pip install uppm[realsense] brings the driver")
COUNT = 4


def intrinsics() -> Any:
    made = rs.intrinsics()
    made.width, made.height, made.fx, made.fy = CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy
    made.ppx, made.ppy, made.model, made.coeffs = CAMERA.cx, CAMERA.cy, rs.distortion.none, [0.0] * 5
    return made


def profile(sensor: Any, kind: Any, form: Any, size: int, number: int) -> Any:
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fps, stream.bpp, stream.fmt = kind, 0, number, 30, size, form
    stream.width, stream.height, stream.intrinsics = CAMERA.width, CAMERA.height, intrinsics()
    return sensor.add_video_stream(stream).as_video_stream_profile()


def record(path: Path) -> None:
    """The room as a recording of the driver's own."""
    device, synced = rs.software_device(), rs.syncer()
    depth, color = device.add_sensor("Depth"), device.add_sensor("Color")
    depth_profile = profile(depth, rs.stream.depth, rs.format.z16, 2, 0)
    color_profile = profile(color, rs.stream.color, rs.format.rgb8, 3, 1)
    depth.add_read_only_option(rs.option.depth_units, 0.001)
    same = rs.extrinsics()
    same.rotation, same.translation = np.eye(3).ravel().tolist(), [0.0, 0.0, 0.0]
    depth_profile.register_extrinsics_to(color_profile, same)
    recorder = rs.recorder(str(path), device)
    sensors = recorder.query_sensors()
    for sensor in sensors:
        sensor.open(sensor.get_stream_profiles())
        sensor.start(synced)
    for n in range(COUNT):
        picture, measured = render(pose(n))
        millimetres = np.rint(1000 * measured).astype("<u2")
        for sensor, own, pixels in ((depth, depth_profile, millimetres), (color, color_profile, picture)):
            image = rs.software_video_frame()
            image.pixels, image.bpp = np.ascontiguousarray(pixels), pixels[0, 0].nbytes
            image.stride, image.frame_number, image.profile = image.bpp * CAMERA.width, n, own
            image.timestamp, image.domain = 100.0 * n + 1, rs.timestamp_domain.system_time
            sensor.on_video_frame(image)
    for sensor in sensors:
        sensor.stop()
        sensor.close()


def test_a_recording_of_the_driver_is_mapped(tmp_path: Path) -> None:
    path = tmp_path / "room.db3"
    record(path)
    stream = RealSenseStream(lambda time: pose(round(10 * time)), recording=path)
    with uppm.LiveMapper(uppm.Mapper(uppm.Config()), policy="block", output=tmp_path / "room.uppm") as live:
        for frame in stream.frames():
            n = round(10 * frame.stamp)
            color, depth = render(pose(n))
            np.testing.assert_array_equal(frame.color, color)
            seen = frame.depth > 0
            assert seen.mean() > 0.95  # aligning leaves gaps at edges
            assert np.median(np.abs(frame.depth - depth)[seen]) < 0.0006
            assert frame.intrinsics == CAMERA
            live.push(frame)
    assert live.statistics.mapped == live.statistics.received == COUNT
    assert len(uppm.open_map(tmp_path / "room.uppm").mesh().faces) > 1000
