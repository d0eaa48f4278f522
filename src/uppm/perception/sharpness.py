"""A cheap judge of blur: the variance of a frame's Laplacian against the sequence's usual (Pech-Pacheco 2000)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.types import Frame

WIDTH = 320
"""Pixels across at which sharpness is measured: less is noise of the sensor."""


def sharpness(color: npt.NDArray[np.uint8]) -> float:
    """Variance of the Laplacian of an RGB image's grey values, at `WIDTH` pixels across."""
    height = max(1, round(color.shape[0] * WIDTH / color.shape[1]))
    small = cv2.resize(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), (WIDTH, height), interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(small, cv2.CV_32F).var())


class SharpnessJudge:
    """Tells blurred frames by the median sharpness of a few frames of the same sequence.

    How sharp an image is depends on what it shows as much as on the camera, so only what falls far below the usual is
    called blurred; without `prepare`, nothing is.

    Parameters
    ----------
    least : float
        Share of the median below which a frame is blurred; 0: none is.
    """

    def __init__(self, least: float) -> None:
        self._least, self._limit = least, 0.0

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Learn the usual from frames spread over the sequence."""
        if frames and self._least:
            self._limit = self._least * float(np.median([sharpness(frame.color) for frame in frames]))

    def is_blurred(self, frame: Frame) -> bool:
        """Whether a frame is much less sharp than the sequence's others."""
        return self._limit > 0 and sharpness(frame.color) < self._limit
