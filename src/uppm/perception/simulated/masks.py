"""Noise on masks and boxes: split, merged, eroded or dilated, jittered."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from uppm.perception.simulated.noise import BoxNoise

Mask = npt.NDArray[np.bool_]
TOUCHING = 2
"""Pixels around a mask in which its neighbour is looked for."""


def box_around(mask: Mask) -> npt.NDArray[np.float64]:
    """(4,) tight box x0, y0, x1, y1 of a mask (H, W) that is not empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float64)


def noisy_box(box: npt.NDArray[np.float64], noise: BoxNoise, shape: tuple[int, int]) -> npt.NDArray[np.float64]:
    """The box (4,) with its sides moved, within the image (height, width) and at least a pixel wide."""
    size = np.tile(box[2:] - box[:2], 2)
    limit = np.array([shape[1], shape[0]], dtype=np.float64)
    moved = box + noise.jitter * size + noise.shift
    low = np.clip(np.minimum(moved[:2], moved[2:]), 0, limit - 1)
    return np.concatenate([low, np.clip(np.maximum(moved[:2], moved[2:]), low + 1, limit)])


def grown(mask: Mask, pixels: float) -> Mask:
    """The mask dilated by so many pixels, or eroded where they are negative; rounded to whole ones."""
    radius = round(abs(pixels))
    if not radius:
        return mask
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    change = cv2.dilate if pixels > 0 else cv2.erode
    # Beyond the image the mask goes on as at its edge: a sofa that the image cuts is not eroded there.
    return change(mask.astype(np.uint8), kernel, borderType=cv2.BORDER_REPLICATE).astype(bool)


def split(mask: Mask, angle: float) -> tuple[Mask, Mask]:
    """The two sides of a mask's centre, cut along a direction, radians."""
    rows, columns = np.nonzero(mask)
    side = (columns - columns.mean()) * np.cos(angle) + (rows - rows.mean()) * np.sin(angle) > 0
    halves = np.zeros((2, *mask.shape), dtype=bool)
    halves[side.astype(int), rows, columns] = True
    return halves[0], halves[1]


def neighbour(instance: npt.NDArray[np.int32], mask: Mask, among: frozenset[int]) -> int | None:
    """The instance, of those given, that a mask has the longest border with; None where it touches none of them."""
    around = grown(mask, TOUCHING) & ~mask
    found, counts = np.unique(instance[around], return_counts=True)
    touching = [(int(count), -int(n)) for n, count in zip(found, counts, strict=True) if int(n) in among]
    return -max(touching)[1] if touching else None


def inside(mask: Mask, box: npt.NDArray[np.float64]) -> Mask:
    """The part of a mask within a box (4,)."""
    x0, y0, x1, y1 = np.round(box).astype(int)
    part = np.zeros_like(mask)
    part[y0:y1, x0:x1] = mask[y0:y1, x0:x1]
    return part
