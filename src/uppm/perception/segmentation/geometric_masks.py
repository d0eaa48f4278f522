"""Masks without a learned model: from a box and the depth, the connected object that fills the box.

The frame is cut once into smooth patches (`surfaces`). For a box: patches that go on outside it are
background, and so is what lies in their planes (the floor between a chair's legs). What is left is split
where the depth jumps; pieces that go on outside the box are other objects; of the rest, the largest piece and
those at its depth are the object. Where depth tells nothing, as of a book on a table, colour decides
(GrabCut). Edges are put right at full size from the depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame
from uppm.perception.segmentation.depth_edges import pieces
from uppm.perception.segmentation.surfaces import Surfaces, surfaces

Mask = npt.NDArray[np.bool_]

MARGIN = 0.35
"""What is seen around the box, as a share of its sides."""
PATCH_INSIDE = 0.7
"""A patch with less of itself in the box is background."""
PIECE_INSIDE = 0.92
"""A connected piece with less of itself in the box is another object."""
MIN_PLANE = 200
"""Background patches at least so large extend to all that lies in their plane, reduced pixels."""
PLANE_RMS = 0.01
PLANE_TOLERANCE = 0.009
"""Metres, before sensor noise."""
OWN_PATCH_SHARE = 0.03
"""A patch that fills so much of the box, and lies in it, is the object's even in the plane of the background."""
KEEP_SHARE = 0.3
"""Dropping other objects must leave so much of the foreground; else they were the object, touching its support."""
DEPTH_MARGIN = (0.3, 0.1)
"""Pieces join the main one within its depth range widened by so much of the range, and of the depth."""
MIN_FILL = 0.1
"""A box filled less than this by depth is segmented by colour."""
COLOR_SIDE = 64
"""Crops are reduced to this for GrabCut, pixels; it keeps its cost under 5 ms."""
SHARPEN = 2
"""Half width of the window in which full-size edges are put right, reduced pixels."""


class GeometricMasks:
    """MaskGenerator on depth, and on colour where depth tells nothing."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config

    def masks(self, frame: Frame, boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """One mask a box (N, 4): (N, H, W)."""
        out = np.zeros((len(boxes), *frame.depth.shape), dtype=bool)
        if not len(boxes):
            return out
        surface = surfaces(frame)
        for mask, box in zip(out, boxes, strict=True):
            view = _look(surface, box / surface.scale)
            if view.inside.any():
                _paint(mask, frame, view, _object(surface, view), box)
        return out


class BoxMasks:
    """MaskGenerator that takes the whole box: the baseline."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config

    def masks(self, frame: Frame, boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """One mask a box (N, 4): (N, H, W)."""
        out = np.zeros((len(boxes), *frame.depth.shape), dtype=bool)
        for mask, box in zip(out, boxes, strict=True):
            mask[_window(box)] = True
        return out


@dataclass(frozen=True, kw_only=True, eq=False)
class _View:
    """A box with its surroundings, in reduced pixels."""

    scale: int
    y: int
    x: int
    inside: Mask
    """(h, w): in the box."""
    patches: npt.NDArray[np.int32]
    points: npt.NDArray[np.float32]
    count: npt.NDArray[np.int64]
    """Pixels of each patch in the box."""
    share: npt.NDArray[np.float64]
    """Share of each patch in the box."""

    @property
    def depth(self) -> npt.NDArray[np.float32]:
        return self.points[..., 2]


def _window(box: npt.NDArray[np.float32]) -> tuple[slice, slice]:
    x0, y0, x1, y1 = (int(v) for v in np.round(np.maximum(box, 0)))
    return np.s_[y0:y1, x0:x1]


def _look(surface: Surfaces, box: npt.NDArray[np.float32]) -> _View:
    height, width = surface.patches.shape
    low, high = np.floor(np.maximum(box[:2], 0)).astype(int), np.ceil(box[2:]).astype(int)
    margin = np.maximum((high - low) * MARGIN, 4).astype(int)
    x0, y0 = np.maximum(low - margin, 0)
    x1, y1 = np.minimum(high + margin, (width, height))
    crop = np.s_[y0:y1, x0:x1]
    inside = np.zeros(surface.patches[crop].shape, dtype=bool)
    inside[low[1] - y0 : high[1] - y0, low[0] - x0 : high[0] - x0] = True
    patches = surface.patches[crop]
    count = np.bincount(patches[inside], minlength=surface.count + 1)
    share = count / np.maximum(surface.sizes, 1)
    share[0] = 1.0
    return _View(
        scale=surface.scale, y=int(y0), x=int(x0), inside=inside, patches=patches,
        points=surface.points[crop], count=count, share=share,
    )  # fmt: skip


def _object(surface: Surfaces, view: _View) -> Mask:
    """The object's pixels (h, w) of the view."""
    background = view.share < PATCH_INSIDE
    free = ~_in_planes(surface, view, background) & (view.depth > 0)
    foreground = free & view.inside & ~background[view.patches]
    parts = pieces(free, view.depth, surface.noise)
    total = np.bincount(parts.ravel())
    own = np.bincount(parts[view.inside], minlength=len(total)) > PIECE_INSIDE * total
    own[0] = False
    kept = foreground & own[parts]
    if np.count_nonzero(kept) < KEEP_SHARE * np.count_nonzero(foreground):
        kept = foreground
    return _main(np.where(kept, parts, 0), view.depth)


def _in_planes(surface: Surfaces, view: _View, background: Mask) -> Mask:
    """Pixels (h, w) in the plane of a background patch."""
    out = np.zeros(view.depth.shape, dtype=bool)
    here = np.bincount(view.patches.ravel(), minlength=surface.count + 1) > 0
    planar = background & here & (surface.sizes > MIN_PLANE) & (surface.rms < PLANE_RMS)
    for plane in surface.planes[planar].astype(np.float32):
        # Noise of the inverse depth moves a point by depth times the plane's offset times it, along the normal.
        tolerance = PLANE_TOLERANCE + 3 * surface.noise * view.depth * abs(plane[3])
        out |= np.abs(view.points @ plane[:3] + plane[3]) < tolerance
    own = (view.share > 0.9) & (view.count > OWN_PATCH_SHARE * np.count_nonzero(view.inside))
    own[0] = False
    return out & ~own[view.patches]


def _main(parts: npt.NDArray[np.int32], depth: npt.NDArray[np.float32]) -> Mask:
    """The piece that fills most of the box, and the pieces at its depth."""
    area = np.bincount(parts.ravel())
    area[0] = 0
    if not area.any():
        return np.zeros(parts.shape, dtype=bool)
    candidates = np.argsort(-area, kind="stable")[:6]
    main = max(candidates, key=lambda i: np.sqrt(area[i]) * _extent(parts == i))
    low, high = np.quantile(depth[parts == main], (0.02, 0.98))
    margin = DEPTH_MARGIN[0] * (high - low) + DEPTH_MARGIN[1] * low
    near = (depth > low - margin) & (depth < high + margin)
    keep = 2 * np.bincount(parts[near], minlength=len(area)) > area
    keep[0] = False
    return keep[parts]


def _extent(mask: Mask) -> int:
    """Area of the mask's bounding box."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int((rows[-1] - rows[0] + 1) * (columns[-1] - columns[0] + 1)) if len(rows) else 0


def _paint(mask: Mask, frame: Frame, view: _View, found: Mask, box: npt.NDArray[np.float32]) -> None:
    """Write the object at full size into `mask` (H, W)."""
    if np.count_nonzero(found) < MIN_FILL * np.count_nonzero(view.inside):
        found = _by_color(frame, view)
    s, radius = view.scale, view.scale * SHARPEN
    height, width = found.shape
    full = cv2.resize(found.astype(np.uint8) * 255, (width * s, height * s), interpolation=cv2.INTER_LINEAR) > 127
    rows, columns = _window(box)
    top, left = max(rows.start - radius, view.y * s), max(columns.start - radius, view.x * s)
    near = np.s_[top : rows.stop + radius, left : columns.stop + radius]
    depth = frame.depth[near]
    offset = np.s_[top - view.y * s :, left - view.x * s :]
    height, width = (min(a, b) for a, b in zip(full[offset].shape, depth.shape, strict=True))
    sharp = np.zeros(depth.shape, dtype=bool)
    sharp[:height, :width] = _sharpen(full[offset][:height, :width], depth[:height, :width], radius)
    mask[rows, columns] = (sharp & (depth > 0))[rows.start - top :, columns.start - left :][
        : rows.stop - rows.start, : columns.stop - columns.start
    ]


def _sharpen(mask: Mask, depth: npt.NDArray[np.float32], radius: int) -> Mask:
    """Near the mask's edge, where the depth differs across it, each pixel goes to the side whose depth it has."""
    window = (2 * radius + 1, 2 * radius + 1)
    inverse = np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0)
    sides = []
    for side in (mask, ~mask):
        weight = (side & (depth > 0)).astype(np.float32)
        share = cv2.boxFilter(weight, -1, window)
        sides.append((share > 0, cv2.boxFilter(weight * inverse, -1, window) / np.maximum(share, 1e-6)))
    (has_front, front), (has_back, back) = sides
    edge = has_front & has_back & (np.abs(front - back) > 0.03 * inverse)
    return np.where(edge, np.abs(inverse - front) < np.abs(inverse - back), mask)


def _by_color(frame: Frame, view: _View) -> Mask:
    """GrabCut on the reduced view: outside the box is background, its inside perhaps the object."""
    height, width = view.inside.shape
    s = view.scale
    color = frame.color[view.y * s : (view.y + height) * s, view.x * s : (view.x + width) * s]
    reduce = min(1.0, COLOR_SIDE / max(height, width))
    size = (max(8, round(width * reduce)), max(8, round(height * reduce)))
    lab = cv2.cvtColor(cv2.resize(color, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2LAB)
    inside = cv2.resize(view.inside.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    labels = np.where(inside > 0, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
    if inside.all() or not inside.any():
        return view.inside
    cv2.setRNGSeed(0)
    model = (np.zeros((1, 65)), np.zeros((1, 65)))
    cv2.grabCut(lab, labels, (0, 0, 0, 0), *model, 2, cv2.GC_INIT_WITH_MASK)
    found = (labels == cv2.GC_PR_FGD).astype(np.float32)
    return cv2.resize(found, (width, height), interpolation=cv2.INTER_LINEAR) > 0.5
