"""Association of segments with submaps by rendered IoU (paper equation 4, method.md section 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from uppm.core.categories import unified_categories

NEW = -1
"""Target of a segment that no submap accounts for."""

MIN_JOIN_PIXELS = 200
"""Overlaps of fewer pixels, a dozen of those that are rendered of a 640x480 image, are chance."""


def iou_matrix(overlap: npt.NDArray[np.int64], observed: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """IoU (S, E) of S rendered submaps with E segments, over pixels with valid depth.

    overlap (S, E + 1): pixels where a submap is rendered, by segment id (column 0: unlabeled); observed (E,): pixels
    of each segment.
    """
    inter = overlap[:, 1:].astype(np.float64)
    union = overlap.sum(axis=1, keepdims=True) + observed[None, :] - inter
    return inter / np.maximum(union, 1)


COVERED, COVERING = 0.8, 0.2
"""Share of a rendered submap within a segment, and of the segment that it fills, for the segment to cover it."""


class CategoryPolicy:
    """Which categories go together, and how much more two of them must overlap than one and the same.

    Parameters
    ----------
    policy : {"same", "compatible", "any"}
        `same` refuses any other category; `any` treats all alike; `compatible` refuses a cosine below `min_cosine` and
        asks for more overlap the less the two agree: up to 0.5 more at `min_cosine`.
    min_cosine : float
    similarity : (C, C) float32
        Cosine of the embeddings of each two unified categories, in the order of the category table.
    certain_iou : float
        With `compatible`, the IoU from which a segment is a submap's whatever the two are called.
    """

    def __init__(
        self, policy: str, min_cosine: float, similarity: npt.NDArray[np.float32], certain_iou: float = 1.0
    ) -> None:
        self._policy, self._min_cosine = policy, min_cosine
        self.certain_iou = certain_iou if policy == "compatible" else np.inf
        # The last row is for categories that are not in the table, and like none but themselves.
        self._similarity = np.pad(similarity, (0, 1), constant_values=-1.0)
        self._row = {category.id: n for n, category in enumerate(unified_categories())}

    def least_overlap(self, first: Sequence[int], second: Sequence[int], base: float) -> npt.NDArray[np.float64]:
        """Least overlap (N, M) at which a category id of `first` goes with one of `second`; inf where it never does."""
        same = np.array(first, dtype=np.int64)[:, None] == np.array(second, dtype=np.int64)[None, :]
        if self._policy == "any":
            return np.full(same.shape, base)
        if self._policy == "same":
            return np.where(same, base, np.inf)
        a, b = (np.array([self._row.get(c, -1) for c in ids], dtype=np.intp) for ids in (first, second))
        cosine = self._similarity[np.ix_(a, b)].astype(np.float64)
        asked = base + 0.5 * (1.0 - cosine) / (1.0 - self._min_cosine)
        return np.where(same, base, np.where(cosine >= self._min_cosine, asked, np.inf))


def assign(iou: npt.NDArray[np.float64], least: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Row of the submap that each segment goes to, or NEW: the one-to-one assignment of greatest total IoU."""
    targets = np.full(iou.shape[1], NEW, dtype=np.intp)
    accepted = iou >= least
    rows, columns = linear_sum_assignment(np.where(accepted, iou, 0.0), maximize=True)
    fits = accepted[rows, columns]
    targets[columns[fits]] = rows[fits]
    return targets


def assign_greedily(iou: npt.NDArray[np.float64], least: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Row of the submap of highest IoU for each segment, or NEW; several segments may go to one (paper equation 4)."""
    if not len(iou):
        return np.full(iou.shape[1], NEW, dtype=np.intp)
    accepted = np.where(iou >= least, iou, -1.0)
    return np.where(accepted.max(axis=0) >= 0, accepted.argmax(axis=0), NEW)


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


def seen_apart(targets: npt.NDArray[np.intp], allowed: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Pairs of submaps (rows) that had a segment each in one frame, and whose categories go together.

    allowed (S, E): whether a submap's category goes with a segment's.
    """
    segments = np.flatnonzero(targets != NEW)
    rows = targets[segments]
    together = allowed[np.ix_(rows, segments)]
    return [(int(rows[a]), int(rows[b])) for a, b in np.argwhere(np.triu(together, 1)) if rows[a] != rows[b]]


def covered_together(
    targets: npt.NDArray[np.intp],
    overlap: npt.NDArray[np.int64],
    observed: npt.NDArray[np.int64],
    allowed: npt.NDArray[np.bool_],
) -> list[tuple[int, int]]:
    """Pairs of submaps (rows) that one segment covers: its target, and another that no segment went to.

    The other is rendered almost wholly within the segment and fills a part of it; a sliver may be the far side of a
    thin wall. Arguments as for `join_contained`.
    """
    rendered = np.maximum(overlap.sum(axis=1, keepdims=True), MIN_JOIN_PIXELS)
    covered = allowed & (overlap[:, 1:] >= COVERED * rendered) & (overlap[:, 1:] >= COVERING * observed[None, :])
    taken = set(targets.tolist())
    return [
        (int(target), int(row))
        for segment, target in enumerate(targets)
        if target != NEW
        for row in np.flatnonzero(covered[:, segment])
        if row not in taken
    ]
