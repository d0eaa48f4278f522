"""The flat of Panoptic Multi-TSDFs (Schmid et al. 2022): a cloud of its surface, and groundtruth_labels.csv.

The cloud has no instances; they come from the frames' own segmentation images (`observed.observe`).
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from uppm.core.errors import InputError
from uppm.evaluation.ground_truth import SurfaceTruth, TruthInstance
from uppm.evaluation.meshes import read_mesh
from uppm.evaluation.truth.class_maps import classify
from uppm.evaluation.truth.scans import beside, labeled

LOOKS_FOR = "flat_1_gt_10000.ply here or in ../ground_truth/RUN/, groundtruth_labels.csv (PanMap's flat)"
CLOUD = "flat_*_gt_*.ply"
LABELS = "groundtruth_labels.csv"


def matches(path: Path) -> bool:
    """There is a cloud of this run."""
    return bool(_clouds(path))


def read(path: Path) -> SurfaceTruth:
    """The whole cloud, its instances unknown."""
    points = read_mesh(_clouds(path)[0]).vertices.astype(np.float64)
    unknown = np.zeros(len(points), dtype=np.int32)
    return SurfaceTruth(source=str(path), points=points, instance=unknown, instances=instances(path), is_observed=False)


def instances(path: Path) -> dict[int, TruthInstance]:
    """The instances of the table that have a unified category."""
    file = beside(path, LABELS)
    expected = "columns InstanceID, PanopticID, Name"
    try:
        with file.open(encoding="utf-8", newline="") as text:
            rows = list(csv.DictReader(text, skipinitialspace=True))
        names = {int(row["InstanceID"]): row["Name"] for row in rows}
        things = {int(row["InstanceID"]) for row in rows if int(row["PanopticID"]) == 1}
    except (OSError, KeyError, TypeError, ValueError) as error:
        found = "no such file" if isinstance(error, FileNotFoundError) else f"{error!r}"
        raise InputError(
            file, expected=expected, found=found, advice="put it beside the run or one folder up"
        ) from None
    known, _ = labeled(names, lambda number, name: classify(name.rstrip("0123456789_ "), "panmap_flat", "scannet"))
    return {n: TruthInstance(**{**vars(i), "is_thing": n in things}) for n, i in known.items()}


def _clouds(path: Path) -> list[Path]:
    folders = (path, path.resolve().parent / "ground_truth" / path.resolve().name)
    return [file for folder in folders for file in sorted(folder.glob(CLOUD))]
