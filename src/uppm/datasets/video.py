"""A colour video with a depth video or depth images, poses and intrinsics."""

from __future__ import annotations

import re
import threading
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError, InputError
from uppm.datasets import files
from uppm.datasets.sequence import RawFrame, RawSequence
from uppm.datasets.times import nearest
from uppm.datasets.trajectory import read_trajectory

VIDEO = r"\.(?:mp4|mov|m4v|avi|mkv|webm)"


class Video:
    looks_for = "color.mp4 (or another video), depth/ or depth.mkv, poses.txt or trajectory.txt, intrinsics.txt"

    @staticmethod
    def matches(path: Path) -> bool:
        return path.is_dir() and _video(path, "color") is not None

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        file = _video(path, "color")
        if file is None:
            found, advice = "none", "see docs/datasets.md"
            raise InputError(path, expected="a video color.mp4 or the like", found=found, advice=advice)
        color = VideoFile(file, depth=False)
        depth = _depth(path)
        stamps = _stamps(path / "stamps.txt", color)
        poses, where = _poses(path, stamps, config.time_tolerance)
        numbers = sorted(number for number in depth if number < color.count)
        if not numbers:
            found = f"{color.count} colour and {len(depth)} depth images with no number in common"
            raise InputError(path, expected="depth images", found=found, advice="number them from 0, as the video")
        camera = files.read_intrinsics(path / "intrinsics.txt", color.size)
        _check_size(path, color.size, depth[numbers[0]]())
        frames = [
            RawFrame(
                where=f"{path}, frame {number}",
                pose_where=f"{where}, frame {number}",
                stamp=float(stamps[number]),
                color=partial(color.frame, number),
                depth=depth[number],
                pose=partial(_pose, poses, number, f"{path}, frame {number}"),
            )
            for number in numbers
        ]
        return RawSequence(
            format="video",
            name=path.resolve().name,
            frames=frames,
            color=camera,
            depth=camera,
            intrinsics_source=str(path / "intrinsics.txt"),
        )


class VideoFile:
    """A video's frames by number, from any thread; it is decoded from its beginning, since seeking is not exact.

    Parameters
    ----------
    depth : bool
        One channel of 16 bit instead of colour.

    Raises
    ------
    InputError
        OpenCV cannot open it.
    """

    def __init__(self, path: Path, *, depth: bool) -> None:
        self.path, self._depth, self._lock = path, depth, threading.Lock()
        self._open()
        width, height = (int(self._capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        self.size = width, height
        self.count = max(int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        """As the file's header says; the last ones may be missing."""
        self.rate = self._capture.get(cv2.CAP_PROP_FPS) or files.FRAME_RATE
        if not self._capture.isOpened() or not self.count:
            advice = "write it as H.264 in .mp4, or depth as 16-bit FFV1 in .mkv"
            raise InputError(path, expected="a video that OpenCV reads", found="another file", advice=advice)

    def _open(self) -> None:
        self._capture, self._next = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG), 0
        self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        if self._depth:
            self._capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)

    def frame(self, number: int) -> npt.NDArray:
        """(H, W, 3) RGB, or (H, W) uint16; raises `BadFrameError` where the video ends before or cannot be decoded."""
        with self._lock:
            if number < self._next:
                self._capture.release()
                self._open()
            more = True
            while more and self._next < number:
                more, self._next = self._capture.grab(), self._next + 1
            more, image = self._capture.read() if more else (False, None)
            self._next += 1
        where = f"{self.path}, frame {number}"
        if not more or image is None:
            found, advice = "a truncated or unreadable video", "copy the video again or leave the frame out"
            raise BadFrameError(where, expected="an image", found=found, advice=advice)
        return self._depth_of(image, where) if self._depth else cv2.cvtColor(image, cv2.COLOR_BGR2RGB)

    def _depth_of(self, image: npt.NDArray, where: str) -> npt.NDArray[np.uint16]:
        depth = image[..., 0] if image.ndim == 3 and image.shape[2] == 1 else image
        if depth.ndim != 2 or depth.dtype != np.uint16:
            channels = 1 if depth.ndim == 2 else depth.shape[2]
            found = f"an image of {depth.dtype} with {channels} channels"
            advice = "write 16-bit FFV1 (gray16le) in .mkv, or PNG images in depth/"
            raise BadFrameError(where, expected="depth of 16 bit in one channel", found=found, advice=advice)
        return depth


def _video(path: Path, stem: str) -> Path | None:
    found = sorted(p for p in path.iterdir() if re.fullmatch(stem + VIDEO, p.name.lower()))
    return found[0] if found else None


def _depth(path: Path) -> dict[int, partial[npt.NDArray]]:
    """Number -> what reads that depth image."""
    images = files.numbered(path / "depth", r"(\d+)\.png")
    if images:
        return {number: partial(files.read_depth, file) for number, file in images.items()}
    file = _video(path, "depth")
    if file is None:
        advice = "write depth/00000.png in mm, or depth.mkv as 16-bit FFV1"
        raise InputError(path, expected="depth images or a depth video", found="neither", advice=advice)
    video = VideoFile(file, depth=True)
    return {number: partial(video.frame, number) for number in range(video.count)}


def _stamps(path: Path, video: VideoFile) -> npt.NDArray[np.float64]:
    """Seconds of each frame of the video: of the file, or by the video's rate."""
    return np.array(files.read_stamps(path, video.count)) if path.exists() else np.arange(video.count) / video.rate


def _poses(path: Path, stamps: npt.NDArray[np.float64], tolerance: float) -> tuple[list[npt.NDArray | None], str]:
    """A pose a frame of the video, None where there is none, and the file that they came from."""
    file = path / "trajectory.txt"
    if not file.exists():
        return [*files.pose_lines(path / "poses.txt", len(stamps))], str(path / "poses.txt")
    times, poses = read_trajectory(file)
    found = nearest(stamps, times, tolerance)
    if (found < 0).all():
        span = f"times {times.min():.3f} to {times.max():.3f} s, and the video {stamps[0]:.3f} to {stamps[-1]:.3f} s"
        advice = "write each frame's time into stamps.txt, on the trajectory's clock"
        raise InputError(file, expected=f"poses within {tolerance} s of the frames", found=span, advice=advice)
    return [poses[i] if i >= 0 else None for i in found], str(file)


def _pose(poses: list[npt.NDArray | None], number: int, where: str) -> npt.NDArray:
    pose = poses[number]
    if pose is None:
        raise BadFrameError(where, expected="a pose near its time", found="no pose", advice="leave the frame out")
    return pose.copy()


def _check_size(path: Path, size: tuple[int, int], depth: npt.NDArray) -> None:
    if depth.shape[::-1] != size:
        found = f"colour of {size[0]}x{size[1]} and depth of {depth.shape[1]}x{depth.shape[0]}"
        advice = "register depth to colour, or convert to the frames layout with depth_intrinsics.txt"
        raise InputError(path, expected="colour and depth of one size", found=found, advice=advice)
