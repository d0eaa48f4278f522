"""A RealSense camera, or its recording, with poses from elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError, MissingExtraError
from uppm.core.types import Frame, Intrinsics

PoseAt = Callable[[float], npt.NDArray[np.float64] | None]
"""Time in seconds -> T_map_camera (4, 4); None where it is not known."""
SIZE, RATE = (640, 480), 30
PATIENCE_MS = 5000
"""Without a frame for so long the stream has ended."""


class RealSenseStream:
    """Frames of the first camera connected, or of a recording of the RealSense viewer; depth aligned to colour.

    Parameters
    ----------
    pose_at : callable
        Poses by the frames' times, which are the camera's (seconds since 1970 with its global time).
    recording : Path, optional
        Play this file instead.

    Raises
    ------
    MissingExtraError
        `pyrealsense2` is not installed.
    InputError
        There is no camera, it does not stream colour and depth, or the file cannot be played.
    """

    def __init__(self, pose_at: PoseAt, *, recording: Path | None = None) -> None:
        try:
            rs: Any = import_module("pyrealsense2")
        except ImportError:
            raise MissingExtraError("pyrealsense2, the camera's driver,", "pip install uppm[realsense]") from None
        self._rs, self._pose_at, self.without_pose = rs, pose_at, 0
        config = rs.config()
        self._pipeline = rs.pipeline()
        try:
            if recording:
                config.enable_device_from_file(str(recording), False)
                # Before it starts: what a recording plays in its own time is dropped where nobody takes it at once.
                played = config.resolve(rs.pipeline_wrapper(self._pipeline)).get_device()
                played.as_playback().set_real_time(False)
            else:
                config.enable_stream(rs.stream.color, *SIZE, rs.format.rgb8, RATE)
                config.enable_stream(rs.stream.depth, *SIZE, rs.format.z16, RATE)
            device = self._pipeline.start(config).get_device()
        except RuntimeError as error:
            where, advice = str(recording or "RealSense"), "see whether realsense-viewer shows both"
            raise InputError(where, expected="colour and depth", found=str(error), advice=advice) from None
        self._align = rs.align(rs.stream.color)
        self._scale = np.float32(device.first_depth_sensor().get_depth_scale())

    def frames(self) -> Iterator[Frame]:
        """Frames until the camera or the recording ends; those without a pose are counted in `without_pose`."""
        index = 0
        try:
            while True:
                came, together = self._pipeline.try_wait_for_frames(PATIENCE_MS)
                if not came:
                    return
                frame = self._frame(self._align.process(together), index)
                if frame is not None:
                    yield frame
                    index += 1
        finally:
            self._pipeline.stop()

    def _frame(self, together: Any, index: int) -> Frame | None:
        color, depth = together.get_color_frame(), together.get_depth_frame()
        if not color or not depth:
            return None
        stamp = color.get_timestamp() / 1000
        pose = self._pose_at(stamp)
        if pose is None:
            self.without_pose += 1
            return None
        profile = color.get_profile().as_video_stream_profile()
        k = profile.get_intrinsics()
        return Frame(
            index=index,
            stamp=stamp,
            color=self._rgb(np.asanyarray(color.get_data()), profile.format()),
            depth=np.asanyarray(depth.get_data()).astype(np.float32) * self._scale,
            T_map_camera=pose,
            intrinsics=Intrinsics(fx=k.fx, fy=k.fy, cx=k.ppx, cy=k.ppy, width=k.width, height=k.height),
        )

    def _rgb(self, image: npt.NDArray[np.uint8], form: Any) -> npt.NDArray[np.uint8]:
        """A copy: the driver uses its own memory again."""
        if form not in (self._rs.format.rgb8, self._rs.format.bgr8):
            raise InputError("RealSense", expected="rgb8 or bgr8", found=str(form), advice="record colour as RGB8")
        return np.array(image if form == self._rs.format.rgb8 else image[..., ::-1])
