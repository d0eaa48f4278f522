"""Points on reconstructed surfaces, uniform by area and seeded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.core.types import Mesh

Points = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePart:
    """The surface of one submap, or of a whole mesh whose parts are not told apart."""

    id: int
    """Unique among the parts of one reconstruction."""
    mesh: Mesh
    """Frame map. Without faces it is a point cloud, and its vertices are the samples."""
    category: str | None = None
    """Unified category; None where nothing is said."""
    is_object: bool = False
    """A countable object rather than background."""
    score: float = 1.0
    """Confidence, 0 to 1; ranks the parts in average precision."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceSamples:
    """R of the metrics: N points of all parts."""

    points: Points
    """(N, 3), metres, frame map."""
    part: npt.NDArray[np.int32]
    """(N,): id of the part that each point is of."""


def sample_surface(mesh: Mesh, points_per_m2: float = 10_000, seed: int | Sequence[int] = 0) -> Points:
    """Points (N, 3) drawn uniformly by area, N = area * density rounded; a mesh without faces gives its vertices.

    Metres, frame of the mesh. The same seed gives the same points (method.md section 7).
    """
    if not len(mesh.faces):
        return mesh.vertices.astype(np.float64)
    return sample_with_faces(mesh, points_per_m2, seed)[0]


def sample_with_faces(
    mesh: Mesh, points_per_m2: float, seed: int | Sequence[int]
) -> tuple[Points, npt.NDArray[np.intp]]:
    """As `sample_surface`, of a mesh with faces, and the face (N,) that each point is on."""
    a, b, c = np.moveaxis(mesh.vertices.astype(np.float64)[mesh.faces], 1, 0)
    ends = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)
    random = np.random.default_rng(seed)
    count = round(ends[-1] * points_per_m2)
    face = np.searchsorted(ends, random.random(count) * ends[-1], side="right")
    root, v = np.sqrt(random.random((count, 1))), random.random((count, 1))
    return (1 - root) * a[face] + root * (1 - v) * b[face] + root * v * c[face], face


def sample_parts(
    parts: Sequence[SurfacePart], points_per_m2: float = 10_000, seed: int = 0, *, source: str = "reconstruction"
) -> SurfaceSamples:
    """Samples of all parts, each drawn with its own stream; raises `InputError` where there is no surface."""
    points = [sample_surface(part.mesh, points_per_m2, (seed, part.id)) for part in parts]
    counts = [len(p) for p in points]
    if not sum(counts):
        found = f"{len(parts)} submaps without any" if parts else "an empty map"
        raise InputError(source, expected="a reconstructed surface", found=found, advice="map a sequence into it first")
    part = np.repeat(np.array([part.id for part in parts], dtype=np.int32), counts)
    return SurfaceSamples(points=np.concatenate(points), part=part)
