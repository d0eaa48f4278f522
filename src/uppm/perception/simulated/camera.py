"""The simulated camera: some of a sequence's frames are blurred by its motion, in colour and in depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.config import SimulatedConfig
from uppm.core.protocols import FrameSource
from uppm.core.types import Frame
from uppm.perception.simulated.noise import blur_noise

MAX_SPREAD = 64
"""Pixels; a longer blur would show nothing."""


class SimulatedCamera:
    """A `FrameSource` that shows another one's frames, a few of them blurred."""

    def __init__(self, source: FrameSource, config: SimulatedConfig) -> None:
        self._source, self._config = source, config

    @property
    def name(self) -> str:
        """The source's."""
        return self._source.name

    @property
    def indices(self) -> Sequence[int]:
        """The source's."""
        return self._source.indices

    def __len__(self) -> int:
        return len(self._source)

    def frame(self, position: int) -> Frame:
        """The frame at a position, blurred where the noise says so."""
        frame = self._source.frame(position)
        noise = blur_noise(frame.index, self._config)
        length = self._config.blur_pixels * self._config.level * frame.intrinsics.width / 640
        return blurred(frame, min(length, MAX_SPREAD), noise.angle) if noise.blurred else frame


def blurred(frame: Frame, length: float, angle: float) -> Frame:
    """The frame as a camera sees it that moves by `length` pixels along `angle`, radians, during the exposure.

    Depth is blurred as colour is, over the pixels that have any: at the edges of objects it lies between them, as with
    structured light and time of flight.
    """
    kernel = motion_kernel(length, angle)
    weight = cv2.filter2D((frame.depth > 0).astype(np.float32), -1, kernel)
    depth = cv2.filter2D(frame.depth, -1, kernel) / np.maximum(weight, 1e-6)
    depth[frame.depth <= 0] = 0
    return replace(frame, color=cv2.filter2D(frame.color, -1, kernel), depth=depth)


def motion_kernel(length: float, angle: float) -> npt.NDArray[np.float32]:
    """(K, K) weights of a straight line through the middle, of sum 1."""
    half = int(np.ceil(length / 2))
    kernel = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.float32)
    steps = np.linspace(-length / 2, length / 2, 4 * half + 1)
    np.add.at(kernel, _cells(steps * np.sin(angle), steps * np.cos(angle), half), 1)
    return kernel / kernel.sum()


def _cells(
    rows: npt.NDArray[np.float64], columns: npt.NDArray[np.float64], half: int
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    return np.round(rows).astype(np.intp) + half, np.round(columns).astype(np.intp) + half
