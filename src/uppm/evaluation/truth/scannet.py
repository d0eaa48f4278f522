"""ScanNet v2 (Dai et al. 2017): SCAN_vh_clean_2.ply, its segments, their groups, and the table of labels."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from uppm.core.errors import InputError
from uppm.evaluation.ground_truth import SurfaceTruth, TruthInstance
from uppm.evaluation.truth.class_maps import LabelClass, classify
from uppm.evaluation.truth.scans import RESTORE, Scan, beside, by_faces, read_json, read_scan, sampled_truth

LOOKS_FOR = "SCAN_vh_clean_2.ply, SCAN.aggregation.json, SCAN_vh_clean_2.0.010000.segs.json (ScanNet)"
MESH = "_vh_clean_2.ply"
LABELS = "scannetv2-labels.combined.tsv"


def matches(path: Path) -> bool:
    """One scan's mesh lies in the folder."""
    return len(list(path.glob(f"*{MESH}"))) == 1


def read(path: Path) -> SurfaceTruth:
    """The scan's surface; objects are numbered from 1, one more than `objectId`."""
    file = next(path.glob(f"*{MESH}"))
    scan = file.name.removesuffix(MESH)
    segments = path / f"{scan}_vh_clean_2.0.010000.segs.json"
    groups = path / f"{scan}.aggregation.json"
    mesh, coarse = read_scan(file).mesh, _nyu40(beside(path, LABELS))
    expected = "segIndices, a number a vertex, and segGroups with objectId, label, segments"
    segmentation, aggregation = read_json(segments, expected), read_json(groups, expected)
    try:
        segment = np.array(segmentation["segIndices"], dtype=np.int64)
        objects = {
            int(g["objectId"]) + 1: (str(g["label"]), list(map(int, g["segments"]))) for g in aggregation["segGroups"]
        }
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(groups, expected=expected, found=f"{error!r}", advice=RESTORE) from None
    if len(segment) != len(mesh.vertices):
        found = f"{len(segment)} numbers for {len(mesh.vertices)} vertices"
        raise InputError(segments, expected=f"those of {file.name}", found=found, advice=RESTORE)
    owner = {s: number for number, (_, members) in objects.items() for s in members}
    values, inverse = np.unique(segment, return_inverse=True)
    ids = np.array([owner.get(int(s), 0) for s in values], dtype=np.int64)[inverse]

    def meaning(number: int, label: str) -> LabelClass | None:
        return classify(label, "scannet", coarse=coarse.get(label, ""))

    labels = {number: label for number, (label, _) in objects.items()}
    return sampled_truth(path, Scan(mesh=mesh, instance=by_faces(mesh, ids)), labels, meaning)


def instances(path: Path) -> dict[int, TruthInstance]:
    """As `read` numbers them."""
    return dict(read(path).instances)


def _nyu40(file: Path) -> dict[str, str]:
    """Raw category -> NYU40 class."""
    columns = ("raw_category", "nyu40class")
    try:
        with file.open(encoding="utf-8", newline="") as text:
            rows = list(csv.DictReader(text, delimiter="\t"))
        return {row["raw_category"]: row["nyu40class"] for row in rows}
    except (OSError, KeyError, UnicodeDecodeError) as error:
        found = "no such file" if isinstance(error, FileNotFoundError) else f"{error!r}"
        advice = f"put {LABELS} beside the scan or one or two folders up"
        raise InputError(file, expected=f"columns {', '.join(columns)}", found=found, advice=advice) from None
