"""Candidate masks -> one id image: things over stuff, higher score first (paper section 3.2.3, method.md section 3)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from uppm.core.categories import SIZE_PRIORS, category_by_name
from uppm.core.types import Detections, Frame, PanopticSegmentation, Segment

REFERENCE_PIXELS = 640 * 480
SMALL_SHARE = 0.4
"""Small things may be smaller than other segments by this factor."""
DUPLICATE_IOU = 0.7
"""Two boxes of different classes that overlap so much are one object."""
CONTAINED = 0.9
"""Two boxes of one class, one of which has this share of its area in the other, are one object."""


def drop_duplicate_boxes(found: Detections) -> tuple[Detections, int]:
    """Keep the best box of each object; also gives how many were dropped."""
    order = np.argsort(-found.scores, kind="stable")
    keep: list[int] = []
    for i in order:
        if not any(_same_object(found, int(i), k) for k in keep):
            keep.append(int(i))
    labels = tuple(found.labels[i] for i in keep)
    return Detections(boxes=found.boxes[keep], scores=found.scores[keep], labels=labels), len(order) - len(keep)


def _same_object(found: Detections, i: int, j: int) -> bool:
    a, b = found.boxes[i], found.boxes[j]
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    shared = float(np.prod(np.maximum(sides, 0)))
    areas = [float(np.prod(box[2:] - box[:2])) for box in (a, b)]
    if shared > DUPLICATE_IOU * (sum(areas) - shared):
        return True
    return found.labels[i].text == found.labels[j].text and shared > CONTAINED * min(areas)


def assemble(
    frame: Frame,
    candidates: Sequence[tuple[npt.NDArray[np.bool_], Segment]],
    min_pixels: int,
    dropped: Counter[str] | None = None,
) -> PanopticSegmentation:
    """Paint the candidates' masks (H, W) into one id image.

    A pixel goes to the first that claims it: things before stuff, then the higher score. `min_pixels` is meant at
    640x480. A segment whose visible rest is too small is dropped and counted in `dropped`.
    """
    counts = Counter(dropped or {})
    ids = np.zeros(frame.depth.shape, dtype=np.int32)
    kept: list[Segment] = []
    for mask, segment in sorted(candidates, key=lambda c: (not c[1].is_thing, -c[1].score)):
        visible = mask & (ids == 0)
        if np.count_nonzero(visible) < _min_area(segment, min_pixels, ids.size):
            counts["too_small" if np.count_nonzero(mask) < min_pixels else "hidden_by_others"] += 1
            continue
        kept.append(segment)
        ids[visible] = len(kept)
    counts["unlabeled_pixels"] = int(np.count_nonzero((ids == 0) & (frame.depth > 0)))
    return PanopticSegmentation(ids=ids, segments=tuple(kept), dropped=dict(counts))


def _min_area(segment: Segment, min_pixels: int, image_pixels: int) -> float:
    category = category_by_name().get(segment.label.text)
    small = category is not None and category.voxel_size == SIZE_PRIORS["small"]
    return min_pixels * image_pixels / REFERENCE_PIXELS * (SMALL_SHARE if small else 1.0)
