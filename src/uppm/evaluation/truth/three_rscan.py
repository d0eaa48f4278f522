"""3RScan (Wald et al. 2019): labels.instances.annotated.v2.ply, and the scan's part of 3DSSG's objects.json."""

from __future__ import annotations

from pathlib import Path

from uppm.core.errors import InputError
from uppm.evaluation.ground_truth import SurfaceTruth, TruthInstance
from uppm.evaluation.truth.class_maps import LabelClass, class_map, classify
from uppm.evaluation.truth.scans import RESTORE, beside, labeled, read_json, read_scan, sampled_truth

LOOKS_FOR = "labels.instances.annotated.v2.ply, objects.json (3RScan)"
MESH = "labels.instances.annotated.v2.ply"
OBJECTS = "objects.json"


def matches(path: Path) -> bool:
    """The annotated mesh lies in the folder."""
    return (path / MESH).exists()


def read(path: Path) -> SurfaceTruth:
    """The scan's surface, by `objectId`."""
    labels, coarse = _objects(path)
    return sampled_truth(path, read_scan(path / MESH, vertex="objectId"), labels, _Classes(coarse))


def instances(path: Path) -> dict[int, TruthInstance]:
    """The scan's objects that have a unified category."""
    labels, coarse = _objects(path)
    return labeled(labels, _Classes(coarse))[0]


class _Classes:
    def __init__(self, coarse: dict[int, str]) -> None:
        self._coarse = coarse

    def __call__(self, number: int, label: str) -> LabelClass | None:
        return classify(label, "3rscan", "scannet", coarse=self._coarse.get(number, ""))


def _objects(path: Path) -> tuple[dict[int, str], dict[int, str]]:
    """Object id -> label, and -> NYU40 class."""
    file = beside(path, OBJECTS)
    expected = 'scans: [{"scan": ..., "objects": [{"id", "label", "nyu40"}]}]'
    name, nyu40 = path.resolve().name, list(class_map("nyu40"))
    content = read_json(file, expected)
    try:
        objects = {entry["scan"]: entry["objects"] for entry in content["scans"]}.get(name, ())
        labels = {int(o["id"]): str(o["label"]) for o in objects}
        # NYU40 classes are numbered from 1, in the order of the table.
        numbers = {int(o["id"]): int(o.get("nyu40") or 0) for o in objects}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(file, expected=expected, found=f"{error!r}", advice=RESTORE) from None
    if not labels:
        found, advice = "none of it", "give the scan's folder its own name"
        raise InputError(file, expected=f"objects of the scan {name}", found=found, advice=advice)
    return labels, {number: nyu40[n - 1] for number, n in numbers.items() if 0 < n <= len(nyu40)}
