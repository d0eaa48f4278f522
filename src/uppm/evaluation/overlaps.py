"""How true and predicted segments overlap: one table that panoptic quality, mAP and mIoU are read from.

Elements are the pixels of an image or the points of a surface. An instance may have several right classes; what it is
counted under is the first of them, and a prediction of any of them counts as that class.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

VOID = 0
"""Truth where nothing is known: such elements count for and against no segment. Prediction: no segment."""
NOTHING = -1
"""Truth where it is known that there is nothing: a prediction there is wrong."""


@dataclass(frozen=True, kw_only=True)
class TrueSegment:
    """What is known of one true segment."""

    classes: tuple[str, ...]
    """Right classes; it is counted under the first."""
    is_thing: bool
    """Countable, so that each is its own segment; all others of a class are one."""


@dataclass(frozen=True, kw_only=True)
class PredictedSegment:
    """What was said of one predicted segment."""

    name: str
    """Class."""
    score: float = 1.0
    """0 to 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlaps:
    """T true and P predicted segments of one image or surface, stuff merged by class."""

    truth: tuple[TrueSegment, ...]
    predicted: tuple[PredictedSegment, ...]
    is_stuff: npt.NDArray[np.bool_]
    """(P,): the prediction is one of true stuff's class, and was merged with all such."""
    intersection: npt.NDArray[np.int64]
    """(T, P), elements."""
    truth_area: npt.NDArray[np.int64]
    """(T,), elements."""
    predicted_area: npt.NDArray[np.int64]
    """(P,), elements that are not void."""
    void_area: npt.NDArray[np.int64]
    """(P,), elements that are void."""

    @property
    def iou(self) -> npt.NDArray[np.float64]:
        """(T, P) intersection over union, void left out."""
        union = self.truth_area[:, None] + self.predicted_area[None, :] - self.intersection
        return self.intersection / np.maximum(union, 1)

    @cached_property
    def right_class(self) -> npt.NDArray[np.bool_]:
        """(T, P): the predicted class is one of the true ones."""
        rows = [[p.name in t.classes for p in self.predicted] for t in self.truth]
        return np.array(rows, dtype=bool).reshape(len(self.truth), len(self.predicted))


def overlaps(
    truth_ids: npt.NDArray[np.integer],
    predicted_ids: npt.NDArray[np.integer],
    truth: Mapping[int, TrueSegment],
    predicted: Mapping[int, PredictedSegment],
) -> Overlaps:
    """Overlaps of two id images (or point labels) of one shape; ids without an entry are void, or no segment.

    Truth: 0 is void, -1 is known to be nothing. Prediction: 0 is none. Stuff of one class becomes one segment; so do
    predictions of its classes, but for those that lie mostly on a thing which has that class too.
    """
    t, p = len(truth), len(predicted)
    # Two rows and a column more: what is known to be nothing, void, and elements without a prediction.
    row = _lookup(truth_ids.ravel(), {number: i for i, number in enumerate(truth)} | {NOTHING: t}, default=t + 1)
    column = _lookup(predicted_ids.ravel(), {number: i for i, number in enumerate(predicted)}, default=p)
    table = np.bincount(row * (p + 1) + column, minlength=(t + 2) * (p + 1)).reshape(t + 2, p + 1)
    truths, predictions = list(truth.values()), list(predicted.values())
    row_keys = [i if s.is_thing else s.classes[0] for i, s in enumerate(truths)]
    column_keys = _prediction_keys(truths, predictions, table)
    table, rows = _merged(table, [*row_keys, NOTHING, "void"])
    columns_first, columns = _merged(table.T, [*column_keys, "none"])
    table = columns_first.T
    present, claimed = table[:-2].sum(axis=1) > 0, table[:, :-1].sum(axis=0) > 0
    rows, columns = np.array(rows[:-2], dtype=int)[present], np.array(columns[:-1], dtype=int)[claimed]
    return Overlaps(
        truth=tuple(truths[i] for i in rows),
        predicted=tuple(predictions[i] for i in columns),
        is_stuff=np.array([isinstance(column_keys[i], str) for i in columns], dtype=bool),
        intersection=table[:-2, :-1][present][:, claimed],
        truth_area=table[:-2].sum(axis=1)[present],
        predicted_area=table[:-1, :-1].sum(axis=0)[claimed],
        void_area=table[-1, :-1][claimed],
    )


def _prediction_keys(
    truth: Sequence[TrueSegment], predicted: Sequence[PredictedSegment], table: npt.NDArray[np.int64]
) -> list[int | str]:
    """What each prediction is merged by: the stuff class that its name is right for, or its own number."""
    stuff = {name: s.classes[0] for s in truth if not s.is_thing for name in s.classes}
    keys: list[int | str] = []
    for i, segment in enumerate(predicted):
        below = truth[int(table[: len(truth), i].argmax())] if truth else None
        is_thing = below is not None and below.is_thing and segment.name in below.classes
        keys.append(i if is_thing else stuff.get(segment.name, i))
    return keys


def _merged(table: npt.NDArray[np.int64], keys: Sequence[int | str]) -> tuple[npt.NDArray[np.int64], list[int]]:
    """Rows of equal key added up, in the order of each key's first row, and those first rows."""
    first: dict[int | str, int] = {}
    for i, key in enumerate(keys):
        first.setdefault(key, i)
    position = {key: n for n, key in enumerate(first)}
    merged = np.zeros((len(first), table.shape[1]), dtype=np.int64)
    np.add.at(merged, [position[key] for key in keys], table)
    return merged, list(first.values())


def _lookup(ids: npt.NDArray[np.integer], of: Mapping[int, int], default: int) -> npt.NDArray[np.int64]:
    keys = np.array(sorted(of), dtype=np.int64)
    values = np.array([*(of[int(key)] for key in keys), default], dtype=np.int64)
    place = np.searchsorted(keys, ids)
    return values[np.where(np.append(keys, ids.max(initial=0) + 1)[place] == ids, place, len(keys))]
