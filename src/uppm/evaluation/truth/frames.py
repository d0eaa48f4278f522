"""The `frames` layout: surface.npz and labels.csv (docs/datasets.md)."""

from __future__ import annotations

import csv
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm.core.categories import category_by_name
from uppm.core.errors import InputError
from uppm.evaluation.ground_truth import SurfaceTruth, TruthInstance

COLUMNS = ("instance", "name", "thing", "categories", "pixels")
LOOKS_FOR = "surface.npz and labels.csv (frames)"


def matches(path: Path) -> bool:
    """It has surface points; what is wrong with its labels is told when they are read."""
    return (path / "surface.npz").exists()


def read(path: Path) -> SurfaceTruth:
    """Points that the cameras saw, and the rows of labels.csv; raises `InputError` naming the file at fault."""
    points, instance = _read_surface(path / "surface.npz")
    known = instances(path)
    unknown = np.setdiff1d(instance, list(known))
    if len(unknown):
        found = f"surface points of instance {unknown[0]}, which it lacks"
        raise InputError(path / "labels.csv", expected="every instance", found=found, advice="add its row")
    return SurfaceTruth(source=str(path), points=points, instance=instance, instances=known)


def instances(path: Path) -> dict[int, TruthInstance]:
    """The rows of labels.csv."""
    return _read_labels(path / "labels.csv")


def _read_surface(file: Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    expected = "arrays xyz_mm (N, 3) int16 and instance (N,) uint16"
    advice = "only a sequence with ground truth can be compared with"
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            xyz, instance = arrays["xyz_mm"], arrays["instance"]
    except FileNotFoundError:
        raise InputError(file, expected=expected, found="no such file", advice=advice) from None
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(file, expected=expected, found=str(error).splitlines()[0], advice=advice) from None
    if xyz.ndim != 2 or xyz.shape[1] != 3 or instance.shape != xyz.shape[:1] or not len(xyz):
        found = f"shapes {xyz.shape} and {instance.shape}"
        raise InputError(file, expected=expected, found=found, advice=advice)
    if not (np.issubdtype(xyz.dtype, np.integer) and np.issubdtype(instance.dtype, np.integer)):
        raise InputError(file, expected=expected, found=f"{xyz.dtype} and {instance.dtype}", advice="save integers")
    return xyz / 1000.0, instance.astype(np.int32)


def _read_labels(file: Path) -> dict[int, TruthInstance]:
    try:
        with file.open(encoding="utf-8", newline="") as text:
            reader = csv.DictReader(text)
            missing = [column for column in COLUMNS if column not in (reader.fieldnames or ())]
            if missing:
                found = f"no column {missing[0]!r}"
                raise InputError(file, expected=f"columns {', '.join(COLUMNS)}", found=found, advice="add it")
            instances = [_instance(row, file, reader.line_num) for row in reader]
    except (OSError, UnicodeDecodeError) as error:
        found = "no such file" if isinstance(error, FileNotFoundError) else str(error)
        raise InputError(file, expected="a table of instances", found=found, advice="restore it") from None
    return {instance.id: instance for instance in instances}


def _instance(row: Mapping[str, str], file: Path, line: int) -> TruthInstance:
    categories = tuple(row["categories"].split("|")) if row["categories"] else ()
    unknown = [name for name in categories if name not in category_by_name()]
    try:
        number, thing, pixels = int(row["instance"]), int(row["thing"]), int(row["pixels"])
    except (TypeError, ValueError):
        found = f"instance {row['instance']!r}, thing {row['thing']!r}, pixels {row['pixels']!r}"
        raise InputError(f"{file}, line {line}", expected="whole numbers", found=found, advice="correct them") from None
    if unknown or not categories:
        found = repr(unknown[0]) if unknown else "none"
        advice = "write it as COCO-Stuff does (docs/retrieval.md)"
        raise InputError(f"{file}, line {line}", expected="unified categories", found=found, advice=advice)
    return TruthInstance(id=number, name=row["name"], is_thing=thing == 1, categories=categories, pixels=pixels)
