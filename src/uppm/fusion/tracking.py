"""Association of segments with submaps by rendered IoU (paper equation 4, method.md section 4)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

NEW = -1
"""Target of a segment that no submap accounts for."""

MIN_JOIN_PIXELS = 50
"""Overlaps of fewer pixels are chance."""


def iou_matrix(overlap: npt.NDArray[np.int64], observed: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """IoU (S, E) of S rendered submaps with E segments, over pixels with valid depth.

    overlap (S, E + 1): pixels where a submap is rendered, by segment id (column 0: unlabeled); observed (E,): pixels
    of each segment.
    """
    inter = overlap[:, 1:].astype(np.float64)
    union = overlap.sum(axis=1, keepdims=True) + observed[None, :] - inter
    return inter / np.maximum(union, 1)


def least_iou(
    submap_categories: npt.NDArray[np.intp],
    segment_categories: npt.NDArray[np.intp],
    similarity: npt.NDArray[np.float32],
    policy: str,
    min_iou: float,
    min_cosine: float,
) -> npt.NDArray[np.float64]:
    """Least IoU (S, E) at which a submap takes a segment; above 1 where it never does.

    Categories are rows of `similarity` (C, C), the cosines of their embeddings. The same category asks for `min_iou`.
    Policy `same` refuses any other; `any` treats all alike; `compatible` refuses a cosine below `min_cosine` and asks
    for more IoU the less the two agree: up to 0.5 more at `min_cosine`.
    """
    same = submap_categories[:, None] == segment_categories[None, :]
    if policy == "any":
        return np.full(same.shape, min_iou)
    if policy == "same":
        return np.where(same, min_iou, np.inf)
    cosine = similarity[submap_categories[:, None], segment_categories[None, :]].astype(np.float64)
    asked = min_iou + 0.5 * (1.0 - cosine) / (1.0 - min_cosine)
    return np.where(same, min_iou, np.where(cosine >= min_cosine, asked, np.inf))


def assign(iou: npt.NDArray[np.float64], least: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Row of the submap that each segment goes to, or NEW: the one-to-one assignment of greatest total IoU."""
    targets = np.full(iou.shape[1], NEW, dtype=np.intp)
    accepted = iou >= least
    rows, columns = linear_sum_assignment(np.where(accepted, iou, 0.0), maximize=True)
    fits = accepted[rows, columns]
    targets[columns[fits]] = rows[fits]
    return targets


def join_contained(
    targets: npt.NDArray[np.intp],
    overlap: npt.NDArray[np.int64],
    observed: npt.NDArray[np.int64],
    allowed: npt.NDArray[np.bool_],
    min_share: float,
) -> npt.NDArray[np.intp]:
    """Give segments without a submap to the one that overlaps them most, relative to the smaller of the two.

    A segment that lies on a submap's known surface is a part of it seen alone (a chair's leg, a wall beside a
    cupboard); a submap whose rendered surface lies in a segment is a part known so far (a wall seen through a door).
    Neither is a new object, though the IoU is low. allowed (S, E): pairs whose categories go together.
    """
    if not len(overlap):
        return targets
    smaller = np.minimum(observed[None, :], overlap.sum(axis=1, keepdims=True))
    share = np.where(allowed, overlap[:, 1:] / np.maximum(smaller, MIN_JOIN_PIXELS), 0.0)
    best = share.argmax(axis=0)
    joins = (targets == NEW) & (share[best, np.arange(len(targets))] >= min_share)
    return np.where(joins, best, targets)
