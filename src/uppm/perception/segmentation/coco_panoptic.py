"""COCO's panoptic format (JSON and PNG), in which other segmenters write, into the folder of `precomputed`.

Kirillov et al., "Panoptic Segmentation", CVPR 2019, and cocodataset.org/#format-results: one PNG an image, whose pixels
hold R + 256 G + 65536 B, and a JSON file that says which category each of these ids is.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.categories import plain_name
from uppm.core.errors import InputError
from uppm.core.folders import whole_folder

ADVICE = "see docs/perception.md for COCO's panoptic format"
MAX_ID = (1 << 16) - 1


@dataclass(frozen=True, kw_only=True)
class Converted:
    """What was written."""

    frames: int
    segments: int
    dropped: Mapping[str, int]
    """Reason -> segments that were left out."""


def convert_coco_panoptic(annotations: Path, images: Path | None, output: Path) -> Converted:
    """Write a folder for the profile `precomputed`, whole or not at all.

    Parameters
    ----------
    annotations : Path
        JSON with `images`, `annotations` and `categories`. The last number in an image's `file_name` is the index of
        its frame.
    images : Path or None
        Folder of the PNG files; None: that of the JSON file's name, or its own.
    output : Path
        Must not exist.

    Raises
    ------
    InputError
        A file is missing or unreadable, or says something that does not fit; the message names it.
    """
    document = _read(annotations)
    folder = images or _default_folder(annotations)
    if not folder.is_dir():
        raise InputError(folder, expected="a folder of PNG files", found="no such folder", advice="use --images")
    with whole_folder(output) as temporary:
        return _convert(annotations, document, folder, temporary)


def _default_folder(annotations: Path) -> Path:
    """COCO puts the images of NAME.json into the folder NAME."""
    named = annotations.with_suffix("")
    return named if named.is_dir() else annotations.parent


def _read(file: Path) -> Mapping[str, Any]:
    expected = "JSON with the lists images, annotations and categories"
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        found = "no such file" if isinstance(error, FileNotFoundError) else str(error)
        raise InputError(file, expected=expected, found=found, advice=ADVICE) from None
    for name in ("images", "annotations", "categories"):
        if not isinstance(document, dict) or not isinstance(document.get(name), list):
            raise InputError(file, expected=expected, found=f"no list {name!r}", advice=ADVICE)
    return document


def _convert(file: Path, document: Mapping[str, Any], folder: Path, output: Path) -> Converted:
    categories = {_get(file, row, "id"): row for row in document["categories"]}
    frames = _frame_indices(file, document["images"])
    segments, dropped = 0, Counter[str]()
    for n, annotation in enumerate(document["annotations"]):
        where = f"{file}, annotation {n}"
        image = _get(where, annotation, "image_id")
        if image not in frames:
            raise InputError(where, expected="the id of an image", found=repr(image), advice=ADVICE)
        ids = _read_png(folder / _get(where, annotation, "file_name"))
        target = output / f"{frames[image]:05d}.png"
        if target.exists():
            raise InputError(where, expected="one annotation an image", found=f"two for {image!r}", advice=ADVICE)
        described = [s for s in _get(where, annotation, "segments_info") if _get(where, s, "id")]
        rows = [_row(where, s, categories) for s in described if not s.get("iscrowd")]
        dropped["crowd"] += len(described) - len(rows)
        dropped["without_pixels"] += _write(where, target, ids, rows)
        segments += len(rows)
    return Converted(frames=len(document["annotations"]), segments=segments, dropped=dict(+dropped))


def _get(where: str | Path, row: Any, name: str) -> Any:
    kinds = {"segments_info": list, "file_name": str, "name": str}
    kind = kinds.get(name, int | str)
    if not isinstance(row, dict) or not isinstance(row.get(name), kind):
        raise InputError(where, expected=f"an object with {name!r}", found=str(row)[:60], advice=ADVICE)
    return row[name]


def _frame_indices(file: Path, images: list[Any]) -> dict[Any, int]:
    """Image id -> frame index: the last number in the name of the image's file."""
    frames: dict[Any, int] = {}
    for row in images:
        name = _get(file, row, "file_name")
        numbers = re.findall(r"\d+", Path(name).stem)
        if not numbers:
            advice = "name the images by their frame, such as 00012.jpg"
            raise InputError(file, expected="file names with the frame's index", found=repr(name), advice=advice)
        if int(numbers[-1]) in frames.values():
            found, advice = f"{name!r} for frame {int(numbers[-1])} again", "convert one sequence at a time"
            raise InputError(file, expected="one image a frame", found=found, advice=advice)
        frames[_get(file, row, "id")] = int(numbers[-1])
    return frames


def _read_png(file: Path) -> npt.NDArray[np.int64]:
    """(H, W) segment ids."""
    if not file.exists():
        raise InputError(file, expected="the PNG of an annotation", found="no such file", advice="use --images FOLDER")
    image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint8 or image.ndim != 3:
        found = "an unreadable file" if image is None else f"{image.dtype} {image.shape}"
        raise InputError(file, expected="an 8-bit RGB image", found=found, advice=ADVICE)
    b, g, r = image[..., :3].astype(np.int64).transpose(2, 0, 1)
    return r + 256 * g + 65536 * b


def _row(where: str, segment: Any, categories: Mapping[Any, Any]) -> tuple[int, str, int, float]:
    """Id, label, thing and score of one segment."""
    number, category = _get(where, segment, "id"), _get(where, segment, "category_id")
    score = segment.get("score", 1.0)
    if category not in categories:
        raise InputError(where, expected="a category_id of categories", found=repr(category), advice=ADVICE)
    if not isinstance(number, int) or number < 1 or not isinstance(score, int | float) or not 0 <= score <= 1:
        found = f"id {number!r}, score {score!r}"
        raise InputError(where, expected="a positive id, a score from 0 to 1", found=found, advice=ADVICE)
    kind = categories[category]
    name, thing = _get(where, kind, "name"), _get(where, kind, "isthing")
    return number, plain_name(name.removesuffix("-merged")), int(bool(thing)), float(score)


def _write(where: str, target: Path, ids: npt.NDArray[np.int64], rows: list[tuple[int, str, int, float]]) -> int:
    """One id image with its table; returns the number of rows that no pixel belongs to."""
    if len(rows) > MAX_ID:
        raise InputError(where, expected=f"up to {MAX_ID} segments", found=str(len(rows)), advice=ADVICE)
    found = set(np.unique(ids).tolist())
    seen = [row for row in rows if row[0] in found]
    out = np.zeros(ids.shape, dtype=np.uint16)
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(("id", "label", "thing", "score"))
    for n, (number, label, thing, score) in enumerate(seen, 1):
        out[ids == number] = n
        writer.writerow((n, label, thing, f"{score:g}"))
    cv2.imwrite(str(target), out)
    target.with_suffix(".csv").write_text(table.getvalue(), encoding="utf-8")
    return len(rows) - len(seen)
