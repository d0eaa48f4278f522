"""Depth steps: what hangs together in depth, and masks cut where they leak over a step (method.md section 3)."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame
from uppm.perception.segmentation.surfaces import depth_noise

Mask = npt.NDArray[np.bool_]
Depth = npt.NDArray[np.float32]
Pieces = npt.NDArray[np.int32]

LINK = 0.02
"""Neighbouring pixels are connected where their depths differ by less than this share of the depth."""
OPEN = 0.25
"""A piece of a mask that goes on outside over so much of its outline is part of another surface."""
APART = 0.05
"""... if its depth lies outside the object's by so much of it."""
MIN_PIECE = 12
"""Smaller pieces stay: they are noise along edges, pixels."""


def linked(a: Depth, b: Depth, noise: float) -> Mask:
    """Whether neighbouring depths belong to one surface; `noise` is the deviation of the inverse depth, 1/m."""
    return np.abs(a - b) < LINK * np.minimum(a, b) + 4 * noise * a * b


def pieces(free: Mask, depth: Depth, noise: float) -> Pieces:
    """Connected components (h, w) of `free` pixels, cut where the depth jumps; 0: not free.

    Pixels and the links between them are laid out on a grid of twice the size, whose components are the pieces.
    """
    height, width = free.shape
    grid = np.zeros((2 * height - 1, 2 * width - 1), dtype=np.uint8)
    grid[::2, ::2] = free
    grid[::2, 1::2] = free[:, 1:] & free[:, :-1] & linked(depth[:, 1:], depth[:, :-1], noise)
    grid[1::2, ::2] = free[1:] & free[:-1] & linked(depth[1:], depth[:-1], noise)
    _, ids = cv2.connectedComponents(grid, connectivity=4)
    return np.ascontiguousarray(ids[::2, ::2], dtype=np.int32)


def cuts(config: PerceptionConfig, *, from_depth: bool) -> bool:
    """Whether masks are to be cut: `auto` leaves those alone that were made from depth in the first place."""
    return config.depth_edges == "cut" or (config.depth_edges == "auto" and not from_depth)


def cut_at_steps(frame: Frame, masks: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.bool_], int]:
    """The masks (N, H, W) without the pieces that leaked over a depth step, and the number of pixels cut."""
    if not len(masks):
        return masks, 0
    noise = depth_noise(frame)
    cut = np.stack([_cut(mask, frame.depth, noise) for mask in masks])
    return cut, int(np.count_nonzero(masks) - np.count_nonzero(cut))


def _cut(mask: Mask, depth: Depth, noise: float) -> Mask:
    """One mask: its main piece, and every other but those that go on outside it at another depth."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return mask
    window = np.s_[max(rows[0] - 1, 0) : rows[-1] + 2, max(columns[0] - 1, 0) : columns[-1] + 2]
    inside, z = mask[window], depth[window]
    parts = pieces(inside & (z > 0), z, noise)
    area = np.bincount(parts.ravel())
    area[0] = 0
    if np.count_nonzero(area) < 2:
        return mask
    openness = _openness(parts, inside, z, noise)
    main = int(np.argmax(area * (1 - openness)))
    suspects = np.flatnonzero((area >= MIN_PIECE) & (openness >= OPEN))
    low, high = np.quantile(z[parts == main], (0.02, 0.98))
    leaks = [i for i in suspects if i != main and _apart(float(np.median(z[parts == i])), low, high)]
    if not leaks:
        return mask
    out = mask.copy()
    out[window] &= ~np.isin(parts, leaks)
    return out


def _openness(parts: Pieces, inside: Mask, z: Depth, noise: float) -> npt.NDArray[np.float64]:
    """(pieces + 1,): share of each piece's outline across which the surface goes on outside the mask."""
    count = int(parts.max()) + 1
    outline, open_ = np.zeros(count), np.zeros(count)
    for a, b in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        on = linked(z[a], z[b], noise) & (z[a] > 0) & (z[b] > 0)
        for here, there in ((a, b), (b, a)):
            edge = (parts[here] > 0) & (parts[here] != parts[there])
            outline += np.bincount(parts[here][edge], minlength=count)
            open_ += np.bincount(parts[here][edge & on & ~inside[there]], minlength=count)
    return open_ / np.maximum(outline, 1)


def _apart(z: float, low: float, high: float) -> bool:
    return z > high * (1 + APART) or z < low * (1 - APART)
