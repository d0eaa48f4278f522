"""Replica (Straub et al. 2019): habitat/mesh_semantic.ply with an object id a face, habitat/info_semantic.json."""

from __future__ import annotations

from pathlib import Path

from uppm.core.errors import InputError
from uppm.evaluation.ground_truth import SurfaceTruth, TruthInstance
from uppm.evaluation.truth.class_maps import LabelClass, classify
from uppm.evaluation.truth.scans import RESTORE, labeled, read_json, read_scan, sampled_truth

LOOKS_FOR = "mesh_semantic.ply, info_semantic.json, here or in habitat/ (Replica)"
MESH, INFO = "mesh_semantic.ply", "info_semantic.json"


def matches(path: Path) -> bool:
    """The annotated mesh lies in the folder or in its habitat/."""
    return (_folder(path) / MESH).exists()


def read(path: Path) -> SurfaceTruth:
    """The scene's surface; objects are numbered from 1, one more than in the files."""
    scan = read_scan(_folder(path) / MESH, face="object_id")
    scan.instance[:] += 1
    return sampled_truth(path, scan, _labels(path), _meaning)


def instances(path: Path) -> dict[int, TruthInstance]:
    """As `read` numbers them."""
    return labeled(_labels(path), _meaning)[0]


def _meaning(number: int, label: str) -> LabelClass | None:
    return classify(label, "replica")


def _labels(path: Path) -> dict[int, str]:
    file = _folder(path) / INFO
    expected = 'objects: [{"id", "class_name"}]'
    content = read_json(file, expected)
    try:
        return {int(o["id"]) + 1: str(o["class_name"]) for o in content["objects"]}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(file, expected=expected, found=f"{error!r}", advice=RESTORE) from None


def _folder(path: Path) -> Path:
    return path if (path / MESH).exists() else path / "habitat"
