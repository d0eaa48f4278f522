"""Non-maximum suppression over open-vocabulary boxes (paper section 3.2.3, method.md section 3)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Detections, Label, Provenance

Boxes = npt.NDArray[np.float32]
Matrix = npt.NDArray[np.bool_]

CORNER_DISTANCE = np.float32(1.5)
"""Two boxes are near-duplicates where each coordinate of both corners differs by at most this, pixels."""


def suppress(found: Detections, config: PerceptionConfig) -> tuple[npt.NDArray[np.intp], Counter[str]]:
    """Indices (K,) of the boxes that survive `config.nms`, in the order given, and how many were dropped by reason."""
    if config.nms == "none":
        return np.arange(len(found.labels)), Counter()
    if config.nms == "classic":
        keep = np.sort(classic(found.boxes, found.scores, label_codes(found.labels), config.nms_iou))
        return keep, +Counter(overlapping_box=len(found.labels) - len(keep))
    return custom(found)


def custom(found: Detections) -> tuple[npt.NDArray[np.intp], Counter[str]]:
    """The paper's suppression: near-duplicates whatever their label, then containment within one label.

    Of near-duplicates the one from a caption stays, then the one with the higher score, then the earlier one. They are
    taken best first, so that a box goes only if one that stays is its duplicate: in a chain a-b-c in which b is
    dropped for a, c stays.
    """
    order = np.lexsort((-found.scores, ~_from_captions(found.labels)))
    unique = order[greedy(_near(found.boxes[order]))]
    inner = _contained(found.boxes[unique], label_codes(found.labels)[unique])
    dropped = Counter(near_duplicate_box=len(order) - len(unique), contained_box=int(np.count_nonzero(inner)))
    return np.sort(unique[~inner]), +dropped


def classic(
    boxes: Boxes, scores: npt.NDArray[np.float32], classes: npt.NDArray[np.integer], max_iou: float
) -> npt.NDArray[np.intp]:
    """Indices, best first, of the boxes that no better one of their class overlaps at an IoU over `max_iou`."""
    order = np.argsort(-scores, kind="stable")
    same = classes[order, None] == classes[order]
    return order[greedy(same & (box_iou(boxes[order], boxes[order]) > max_iou))]


def greedy(conflict: Matrix) -> npt.NDArray[np.intp]:
    """Rows of a symmetric matrix (N, N), sorted best first, that are in conflict with no better one that stays."""
    others = conflict & ~np.eye(len(conflict), dtype=bool)
    gone = np.zeros(len(conflict), dtype=bool)
    for i in np.flatnonzero(others.any(axis=1)).tolist():
        # One that stays conflicts with none before it that stays, so that marking its whole row is right.
        if not gone[i]:
            gone |= others[i]
    return np.flatnonzero(~gone)


def box_iou(a: Boxes, b: Boxes) -> npt.NDArray[np.float32]:
    """(N, M) intersection over union of boxes (N, 4) and (M, 4)."""
    # Coordinate by coordinate: whole rows in a row, where (N, M, 2) would be strided.
    (x0, y0, x1, y1), (u0, v0, u1, v1) = a.T[..., None], np.ascontiguousarray(b.T)
    shared = np.maximum(np.minimum(x1, u1) - np.maximum(x0, u0), 0)
    shared *= np.maximum(np.minimum(y1, v1) - np.maximum(y0, v0), 0)
    union = (x1 - x0) * (y1 - y0) + (u1 - u0) * (v1 - v0) - shared
    return shared / np.maximum(union, np.finfo(np.float32).tiny)


def label_codes(labels: Sequence[Label]) -> npt.NDArray[np.intp]:
    """(N,) a number for each label text."""
    codes: dict[str, int] = {}
    return np.array([codes.setdefault(label.text, len(codes)) for label in labels], dtype=np.intp)


def _from_captions(labels: Sequence[Label]) -> npt.NDArray[np.bool_]:
    return np.array([label.provenance is Provenance.CAPTION for label in labels], dtype=bool)


def _near(boxes: Boxes) -> Matrix:
    near = np.ones((len(boxes), len(boxes)), dtype=bool)
    for side in np.ascontiguousarray(boxes.T):
        near &= np.abs(side[:, None] - side) <= CORNER_DISTANCE
    return near


def _contained(boxes: Boxes, codes: npt.NDArray[np.intp]) -> Matrix:
    """(N,) whether another box of the same label has the whole of it. No two boxes are equal."""
    inside = codes[:, None] == codes
    for side in range(4):
        edge = boxes[:, side] if side < 2 else -boxes[:, side]
        inside &= edge[:, None] >= edge
    np.fill_diagonal(inside, False)
    return inside.any(axis=1)
