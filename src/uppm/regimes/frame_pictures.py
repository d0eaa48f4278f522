"""Where a front end is wrong in a frame: the frame, its true instances, and its segments by what is right or wrong."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.types import DescribedSegmentation, Frame
from uppm.evaluation.error_colors import InstanceError, instance_colors
from uppm.evaluation.ground_truth import TruthInstance
from uppm.evaluation.instances import MAIN_SHARE
from uppm.map.palette import distinct

Image = npt.NDArray[np.uint8]

WIDTH = 480
"""Of each of the three pictures."""
_GAP = 6
_TINT = 0.65
"""Share of the colour that says something in what is drawn over the frame."""
LEGEND = {
    InstanceError.RIGHT: "its main instance, under a right category",
    InstanceError.MISNAMED: "its main instance, under a wrong category",
    InstanceError.FOREIGN: "another instance than its main one",
    InstanceError.UNLABELED: "no segment",
    InstanceError.NO_TRUTH: "no true instance",
}


def draw_frame(frame: Frame, found: DescribedSegmentation, instances: Mapping[int, TruthInstance]) -> Image:
    """The frame, its true instances and its segments' errors side by side, RGB; the frame must have ground truth."""
    if frame.truth is None:
        raise ValueError("a frame without ground truth cannot be compared")
    truth = np.where(np.isin(frame.truth.instance, list(instances)), frame.truth.instance, 0)
    grey = np.repeat(cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2).astype(np.uint8)
    shown = (frame.color, _tinted(grey, _own_colors(truth)), _tinted(grey, _errors(truth, found, instances)))
    height = round(WIDTH * frame.color.shape[0] / frame.color.shape[1])
    small = [cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA) for image in shown]
    gap = np.full((height, _GAP, 3), 255, dtype=np.uint8)
    return np.concatenate([small[0], gap, small[1], gap, small[2]], axis=1).astype(np.uint8)


def _errors(
    truth: npt.NDArray[np.integer], found: DescribedSegmentation, instances: Mapping[int, TruthInstance]
) -> Image:
    names: dict[int, str | None] = {n: d.category.name for n, d in enumerate(found.descriptors, start=1)}
    owners = {n: _main_instance(truth[found.ids == n]) for n in names}
    colors = instance_colors(names | {0: None}, found.ids.ravel(), truth.ravel(), owners, instances)
    return colors.reshape(*truth.shape, 3)


def _main_instance(truth: npt.NDArray[np.integer]) -> int:
    """The instance of more than half of a segment's pixels, or 0."""
    numbers, counts = np.unique(truth, return_counts=True)
    if not len(counts) or counts.max() <= MAIN_SHARE * len(truth):
        return 0
    return int(numbers[counts.argmax()])


def _own_colors(instance: npt.NDArray[np.integer]) -> Image:
    """A colour for each instance; grey where none is known."""
    numbers, index = np.unique(instance, return_inverse=True)
    colors = [distinct(int(n)) if n else InstanceError.UNLABELED.value for n in numbers]
    return np.array(colors, dtype=np.uint8)[index.ravel()].reshape(*instance.shape, 3)


def _tinted(grey: Image, colors: Image) -> Image:
    return np.rint((1 - _TINT) * grey + _TINT * colors.astype(np.float64)).astype(np.uint8)
