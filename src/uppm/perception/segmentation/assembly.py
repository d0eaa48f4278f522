"""Candidate masks -> one id image: things over stuff, higher score first (paper section 3.2.3, method.md section 3)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from uppm.core.categories import SIZE_PRIORS, category_by_name
from uppm.core.types import Detections, Frame, PanopticSegmentation, Provenance, Segment

Mask = npt.NDArray[np.bool_]

REFERENCE_PIXELS = 640 * 480
SMALL_SHARE = 0.4
"""Small things may be smaller than other segments by this factor."""
DUPLICATE_IOU = 0.7
"""Two boxes of different classes that overlap so much are one object."""
CONTAINED = 0.9
"""Two boxes of one class, one of which has this share of its area in the other, are one object."""
NESTED = 0.7
"""A mask with this share in another's lies on it."""
SMALLER = 0.5
"""... if it is smaller than this share of the other."""
MIN_VISIBLE = 0.5
"""A table top that others cover more than this was theirs: a bed's, a desk's."""


def distinct_boxes(found: Detections, among: npt.NDArray[np.intp]) -> list[int]:
    """Indices, of those given, of the best box of each object, best first."""
    keep: list[int] = []
    for i in among[np.argsort(-found.scores[among], kind="stable")]:
        if not any(_same_object(found, int(i), k) for k in keep):
            keep.append(int(i))
    return keep


def _same_object(found: Detections, i: int, j: int) -> bool:
    a, b = found.boxes[i], found.boxes[j]
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    shared = float(np.prod(np.maximum(sides, 0)))
    areas = [float(np.prod(box[2:] - box[:2])) for box in (a, b)]
    if shared > DUPLICATE_IOU * (sum(areas) - shared):
        return True
    return found.labels[i].text == found.labels[j].text and shared > CONTAINED * min(areas)


def assemble(
    frame: Frame, candidates: Sequence[tuple[Mask, Segment]], min_pixels: int, dropped: Mapping[str, int] | None = None
) -> PanopticSegmentation:
    """Paint the candidates' masks (H, W) into one id image.

    A pixel goes to the first that claims it, in the order of `paint_order`. `min_pixels` is meant at 640x480. A segment
    whose visible rest is too small is dropped and counted; `dropped` holds what was counted before.
    """
    counts = Counter(dropped or {})
    ids = np.zeros(frame.depth.shape, dtype=np.int32)
    kept: list[Segment] = []
    for i in paint_order(candidates):
        mask, segment = candidates[i]
        visible = mask & (ids == 0)
        whole, least = np.count_nonzero(mask), _min_area(segment, min_pixels, ids.size)
        if segment.is_thing and segment.label.provenance is Provenance.STRUCTURE:
            least = max(least, MIN_VISIBLE * whole)
        if np.count_nonzero(visible) < least:
            counts["too_small" if whole < least else "hidden_by_others"] += 1
            continue
        kept.append(segment)
        ids[visible] = len(kept)
    counts["unlabeled_pixels"] = int(np.count_nonzero((ids == 0) & (frame.depth > 0)))
    return PanopticSegmentation(ids=ids, segments=tuple(kept), dropped=dict(counts))


def paint_order(candidates: Sequence[tuple[Mask, Segment]]) -> list[int]:
    """Indices in the order of their claims: things before stuff, a thing on a larger thing before it, higher score.

    A table's mask holds what stands on it, since depth shows no gap there: a thing that lies for the most part within
    another's mask and is much smaller is painted first.
    """
    masks = np.stack([mask[::4, ::4].ravel() for mask, _ in candidates]) if candidates else np.zeros((0, 1), dtype=bool)
    # One array with itself: NumPy then takes the product for symmetric matrices, which other threads hold up less.
    small = masks.astype(np.float32)
    shared = small @ small.T
    area = np.maximum(np.diag(shared), 1)
    within = (shared > NESTED * area[:, None]) & (area[:, None] < SMALLER * area)
    thing = np.array([segment.is_thing for _, segment in candidates], dtype=bool)
    depth = (within & thing & thing[:, None]).sum(axis=1)
    return sorted(range(len(candidates)), key=lambda i: (not thing[i], -depth[i], -candidates[i][1].score))


def _min_area(segment: Segment, min_pixels: int, image_pixels: int) -> float:
    category = category_by_name().get(segment.label.text)
    small = category is not None and category.voxel_size == SIZE_PRIORS["small"]
    return min_pixels * image_pixels / REFERENCE_PIXELS * (SMALL_SHARE if small else 1.0)
