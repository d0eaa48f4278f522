"""What the readers of annotated scans share: PLY files with labels, points sampled on them, JSON files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError, MissingExtraError
from uppm.core.types import Mesh
from uppm.evaluation.ground_truth import SurfaceTruth, TruthInstance
from uppm.evaluation.sampling import sample_with_faces
from uppm.evaluation.truth.class_maps import LabelClass

RESTORE = "restore the file, or fetch it again"


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """A mesh whose faces are labeled."""

    mesh: Mesh
    instance: npt.NDArray[np.int64]
    """(F,): the scan's own object id of each face."""


def read_scan(file: Path, *, vertex: str = "", face: str = "") -> Scan:
    """A PLY mesh with an object id a vertex, or a face, in the property of that name; polygons become triangles.

    Without a name all ids are 0.

    Raises
    ------
    InputError
        The file is no such PLY mesh.
    MissingExtraError
        There is no plyfile.
    """
    elements = _read_ply(file)
    points, polygons = elements["vertex"].data, elements["face"].data
    for kind, name, data in (("vertex", vertex, points), ("face", face, polygons)):
        if name and name not in data.dtype.names:
            found = ", ".join(data.dtype.names)
            raise InputError(file, expected=f"a {kind} property {name}", found=found, advice=RESTORE)
    corners = polygons[next(n for n in ("vertex_indices", "vertex_index") if n in polygons.dtype.names)]
    faces, polygon = _triangles(corners)
    vertices = np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float32)
    if len(faces) and faces.max() >= len(vertices):
        found = f"one of vertex {faces.max()}"
        raise InputError(file, expected=f"faces of its {len(vertices)} vertices", found=found, advice=RESTORE)
    flat = np.zeros_like(vertices)
    mesh = Mesh(vertices=vertices, normals=flat, colors=flat.astype(np.uint8), faces=faces)
    if face:
        return Scan(mesh=mesh, instance=polygons[face].astype(np.int64)[polygon])
    ids = points[vertex].astype(np.int64) if vertex else np.zeros(len(vertices), dtype=np.int64)
    return Scan(mesh=mesh, instance=by_faces(mesh, ids))


def _read_ply(file: Path) -> Any:
    try:
        from plyfile import PlyData, PlyParseError  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise MissingExtraError("plyfile, which reads annotated scans,", "pip install uppm[eval]") from None
    try:
        found = PlyData.read(str(file))
        names = {element.name: element.data.dtype.names for element in found.elements}
    except (OSError, ValueError, EOFError, PlyParseError) as error:
        text = "no such file" if isinstance(error, FileNotFoundError) else str(error)
        raise InputError(file, expected="a PLY mesh", found=text, advice=RESTORE) from None
    if not {"x", "y", "z"} <= set(names.get("vertex", ())) or not {"vertex_indices", "vertex_index"} & set(
        names.get("face", ())
    ):
        text = "; ".join(f"{name}: {', '.join(properties)}" for name, properties in names.items())
        raise InputError(file, expected="vertices x, y, z and faces vertex_indices", found=text, advice=RESTORE)
    return found


def _triangles(polygons: npt.NDArray[np.object_]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.intp]]:
    """Fans (F, 3) of convex polygons, and the row of the polygon that each is of."""
    counts = np.array([len(p) for p in polygons])
    faces, rows = [np.empty((0, 3), dtype=np.int32)], [np.empty(0, dtype=np.intp)]
    for count in np.unique(counts[counts > 2]):
        row = np.flatnonzero(counts == count)
        corners = np.stack([polygons[i] for i in row.tolist()]).astype(np.int32)
        for last in range(2, count):
            faces.append(corners[:, [0, last - 1, last]])
            rows.append(row)
    return np.concatenate(faces), np.concatenate(rows)


def by_faces(mesh: Mesh, ids: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """(F,) label of each face: the one that two of its corners share, or its first corner's; from labels (V,)."""
    a, b, c = ids[mesh.faces].T
    return np.where(b == c, b, a)


def sampled_truth(
    source: Path,
    scan: Scan,
    labels: Mapping[int, str],
    classify: Callable[[int, str], LabelClass | None],
    points_per_m2: float = 10_000,
) -> SurfaceTruth:
    """G of a labeled mesh: points drawn uniformly by area, as the reconstruction's are (method.md section 7).

    Parameters
    ----------
    labels : object id -> label; points of other objects are unknown.
    classify : object id and label -> meaning; objects without one are unknown.
    """
    points, face = sample_with_faces(scan.mesh, points_per_m2, seed=0)
    raw = scan.instance[face]
    known, unmapped = labeled(labels, classify)
    return SurfaceTruth(
        source=str(source),
        points=points,
        instance=np.where(np.isin(raw, list(known)), raw, 0).astype(np.int32),
        instances=known,
        is_observed=False,
        unmapped=unmapped,
    )


def labeled(
    labels: Mapping[int, str], classify: Callable[[int, str], LabelClass | None]
) -> tuple[dict[int, TruthInstance], tuple[str, ...]]:
    """Object id -> instance, and the labels without a unified category. Id 0 is never an object."""
    known: dict[int, TruthInstance] = {}
    unmapped: dict[str, None] = {}
    for number, label in labels.items():
        meaning = classify(number, label)
        if number == 0 or meaning is None:
            unmapped[label] = None
            continue
        known[number] = TruthInstance(
            id=number, name=label, is_thing=meaning.is_thing, categories=meaning.categories, pixels=None
        )
    return known, tuple(unmapped)


def read_json(file: Path, expected: str) -> Any:
    """A JSON document; raises `InputError` where there is none."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        found = "no such file" if isinstance(error, FileNotFoundError) else str(error).splitlines()[0]
        raise InputError(file, expected=expected, found=found, advice=RESTORE) from None


def beside(path: Path, name: str, levels: int = 2) -> Path:
    """The file of that name in the folder, or up to so many folders above; the folder's own where none has it."""
    folder = path.resolve()
    candidates = [folder / name, *(parent / name for parent in list(folder.parents)[:levels])]
    return next((file for file in candidates if file.exists()), path / name)
