"""The profile `precomputed`: id images that any segmenter wrote to disk (docs/perception.md)."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.errors import ConfigError, InputError
from uppm.core.types import Frame, Label, PanopticSegmentation, Provenance, Segment

ADVICE = "see docs/perception.md for the layout"


class PrecomputedSegmenter:
    """Reads NNNNN.png (16-bit ids, 0: unlabeled) by frame index, named by labels.csv or the frame's own NNNNN.csv."""

    def __init__(self, config: PerceptionConfig) -> None:
        if config.precomputed is None:
            advice = "use --set perception.precomputed=FOLDER"
            raise ConfigError("perception.precomputed", expected="a folder of id images", found="none", advice=advice)
        self._folder = config.precomputed
        if not self._folder.is_dir():
            raise InputError(self._folder, expected="a folder of id images", found="no such folder", advice=ADVICE)
        table = self._folder / "labels.csv"
        self._segments = read_label_table(table) if table.exists() else {}

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Nothing to learn from the sequence."""

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        """The segments on disk for this frame.

        Raises
        ------
        InputError
            The image or a label is missing, unreadable or of another size than the frame.
        """
        file = self._folder / f"{frame.index:05d}.png"
        image = read_id_image(file, frame.depth.shape)
        own = file.with_suffix(".csv")
        table = read_label_table(own) if own.exists() else self._segments
        found, inverse = np.unique(image, return_inverse=True)
        missing = [int(i) for i in found if i and int(i) not in table]
        if missing:
            expected = f"a label for id {missing[0]} in {own.name} or labels.csv"
            raise InputError(file, expected=expected, found="none", advice="add the row, or set these pixels to 0")
        ids = np.cumsum(found > 0).astype(np.int32)
        ids = np.where(found > 0, ids, 0)[inverse].reshape(image.shape).astype(np.int32)
        unlabeled = int(np.count_nonzero((ids == 0) & (frame.depth > 0)))
        segments = tuple(table[int(i)] for i in found if i)
        return PanopticSegmentation(ids=ids, segments=segments, dropped={"unlabeled_pixels": unlabeled})


def read_id_image(file: Path, shape: tuple[int, ...]) -> npt.NDArray[np.uint16]:
    """(H, W) ids of one frame."""
    if not file.exists():
        raise InputError(file, expected="an id image of this frame", found="no such file", advice=ADVICE)
    image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(file, expected="a PNG image", found="an unreadable file", advice="write it again")
    if image.dtype not in (np.uint8, np.uint16) or image.shape != shape:
        expected = f"an 8-bit or 16-bit one-channel image of {shape[1]}x{shape[0]} pixels"
        raise InputError(file, expected=expected, found=f"{image.dtype} {image.shape}", advice=ADVICE)
    return image.astype(np.uint16)


def read_label_table(file: Path) -> Mapping[int, Segment]:
    """Id -> segment, from the columns id, label, thing (0 or 1) and, if there, score."""
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True)
            lacking = {"id", "label", "thing"} - set(reader.fieldnames or ())
            if lacking:
                found = f"no column {sorted(lacking)[0]!r}"
                raise InputError(file, expected="columns id, label, thing, score", found=found, advice=ADVICE)
            return dict(_row(file, reader.line_num, row) for row in reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(file, expected="a CSV table in UTF-8", found=str(error), advice=ADVICE) from None


def _row(file: Path, line: int, row: Mapping[str, str | None]) -> tuple[int, Segment]:
    where = f"{file}, line {line}"
    text = (row["label"] or "").strip()
    try:
        number, thing, score = int(row["id"] or ""), int(row["thing"] or ""), float(row.get("score") or 1.0)
    except ValueError as error:
        raise InputError(where, expected="numbers for id, thing, score", found=str(error), advice=ADVICE) from None
    if not text or thing not in (0, 1) or not 1 <= number < 1 << 16:
        expected = "an id from 1 to 65535, a label, and thing 0 or 1"
        raise InputError(where, expected=expected, found=f"{number}, {text!r}, {thing}", advice=ADVICE)
    label = Label(text=text, provenance=Provenance.PRECOMPUTED)
    return number, Segment(label=label, score=score, is_thing=thing == 1)
