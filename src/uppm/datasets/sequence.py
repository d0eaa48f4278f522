"""From a reader's raw frames to `Frame`s: the one place where the input options act and frames are judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.config import InputConfig
from uppm.core.errors import BadFrameError, InputError
from uppm.core.types import Frame, GroundTruth, Intrinsics
from uppm.core.validation import check_pose
from uppm.datasets.noise import structured_light
from uppm.datasets.poses import pose_matrix

Image = npt.NDArray[np.uint8]
Raw = npt.NDArray[np.generic]


@dataclass(frozen=True, kw_only=True)
class RawFrame:
    """One frame as its files say it; each part is read when called, and raises `BadFrameError`."""

    where: str
    """The frame, for messages."""
    pose_where: str
    """The file or line of its pose, for messages."""
    stamp: float
    """Seconds."""
    color: Callable[[], Image]
    """(H, W, 3) uint8, RGB, in the colour camera."""
    depth: Callable[[], Raw]
    """(h, w), the format's units along the optical axis of the depth camera; 0: invalid."""
    pose: Callable[[], npt.NDArray[np.float64]]
    """(4, 4), or (7,): translation and quaternion in the file's order."""
    truth: Callable[[], GroundTruth | None] = lambda: None


@dataclass(frozen=True, kw_only=True)
class RawSequence:
    """What a reader returns: the frames, and what they share."""

    format: str
    name: str
    frames: Sequence[RawFrame]
    color: Intrinsics
    """The colour camera, which is the frames' camera; poses are its."""
    depth: Intrinsics
    """The depth camera."""
    T_color_depth: npt.NDArray[np.float64] | None = None
    """(4, 4); None: the two are one camera, or depth is registered already."""
    depth_scale: float = 1000.0
    """Depth units a metre."""
    quaternions: bool = False
    """The pose file holds quaternions."""
    intrinsics_source: str = "intrinsics.txt"
    """Where the intrinsics came from, for messages."""


class PosedSequence:
    """A posed RGB-D sequence, a `FrameSource`; options of `InputConfig` are applied here.

    Parameters
    ----------
    raw : RawSequence
        What a reader found.
    config : InputConfig
        Stride, count, pose and depth conventions.
    """

    def __init__(self, raw: RawSequence, config: InputConfig = InputConfig()) -> None:  # noqa: B008 (frozen)
        self.raw, self.config, self.name = raw, config, raw.name
        self._positions = range(0, len(raw.frames), config.stride)[: config.max_frames]
        if not self._positions:
            raise InputError(raw.name, expected="at least one frame", found="none", advice="check the folder")

    def __len__(self) -> int:
        return len(self._positions)

    @property
    def indices(self) -> Sequence[int]:
        """Position in the whole sequence of each frame used."""
        return self._positions

    @property
    def depth_scale(self) -> float:
        """Depth image units a metre."""
        return self.config.depth_scale or self.raw.depth_scale

    def pose(self, index: int) -> npt.NDArray[np.float64]:
        """T_map_camera (4, 4) of the index-th frame used, without reading its images; raises `BadFrameError`."""
        raw, where = self.raw_pose(index)
        pose = pose_matrix(raw, where, self.config)
        try:
            check_pose(where, pose)
        except InputError as error:
            found = "NaN or infinity in the pose" if not np.isfinite(pose).all() else "a pose that is not rigid"
            raise BadFrameError(where, expected=error.expected, found=found, advice=error.advice) from None
        return pose

    def raw_pose(self, index: int) -> tuple[npt.NDArray[np.float64], str]:
        """The pose as its file has it, (4, 4) or (7,), and where that is; raises `BadFrameError`."""
        frame = self.raw.frames[self._positions[index]]
        return frame.pose(), frame.pose_where

    def frame(self, index: int) -> Frame:
        """The index-th frame used; `Frame.index` is its position in the whole sequence.

        Raises
        ------
        BadFrameError
            A file is missing or unreadable, the pose is not finite and rigid, or an image has another size.
            `error.found` is a short reason by which frames can be counted.
        """
        position = self._positions[index]
        frame = self.raw.frames[position]
        pose = self.pose(index)
        return Frame(
            index=position,
            stamp=frame.stamp,
            color=_checked(frame, "colour", frame.color(), self.raw.color),
            depth=self._noisy(self._depth(frame), position),
            T_map_camera=pose,
            intrinsics=self.raw.color,
            truth=self._truth(frame),
        )

    def _depth(self, frame: RawFrame) -> npt.NDArray[np.float32]:
        depth = _checked(frame, "depth", frame.depth(), self.raw.depth).astype(np.float32)
        depth /= np.float32(self.depth_scale)
        depth[~(np.isfinite(depth) & (depth > 0))] = 0
        if self.raw.T_color_depth is None:
            return depth
        from uppm.datasets.registration import register_depth  # compiles a kernel, which few sequences need

        size = (self.raw.color.width, self.raw.color.height)
        return register_depth(depth, self.raw.depth.matrix, self.raw.color.matrix, self.raw.T_color_depth, size)

    def _noisy(self, depth: npt.NDArray[np.float32], position: int) -> npt.NDArray[np.float32]:
        if self.config.depth_noise == "none":
            return depth
        return structured_light(depth, self.raw.color.fx, self.config.noise_seed, position)

    def _truth(self, frame: RawFrame) -> GroundTruth | None:
        truth = frame.truth()
        if truth is not None:
            _checked(frame, "instance", truth.instance, self.raw.color)
        return truth


def _checked(frame: RawFrame, what: str, image: npt.NDArray[np.generic], camera: Intrinsics) -> npt.NDArray:
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        expected = f"a {what} image of {camera.width}x{camera.height} as in the rest of the sequence"
        found = f"a {what} image of {width}x{height}"
        raise BadFrameError(frame.where, expected=expected, found=found, advice="drop the frame or export it again")
    return image
