"""Where one map lies in another: iterative closest points, point to plane (docs/change-detection.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from uppm.core.errors import InputError
from uppm.core.geometry import transform
from uppm.core.types import Mesh

REACHES = (0.6, 0.3, 0.15, 0.08)
"""Metres within which points are paired, coarse to fine; the last is also an inlier's."""
ROUNDS, STILL = 15, 1e-5
"""Rounds at each reach at most, and the step (metres, radians) below which the next reach follows."""
MAX_POINTS = 20_000
"""Vertices of the old map, spread evenly, that are paired."""
FACING = 0.7
"""Least cosine between the normals of a pair."""
ROBUST = 0.02
"""Metres from which residuals count less: what was moved between the visits may not pull."""
MIN_FITNESS = 0.5
"""Share of inliers below which the maps are not taken to be of one place."""

Pose = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Registration:
    """The pose of an old map in a new one, and how well it fits."""

    T_new_old: Pose
    """(4, 4)."""
    fitness: float
    """Share of the old map's points with one of the new map nearby, facing alike."""
    rmse: float
    """Of those, the root of the mean squared distance along the new map's normals, metres."""


def register(old: Mesh, new: Mesh) -> Registration:
    """Pose of the old mesh in the new one's frame, from within about half a metre and 10 degrees.

    Raises
    ------
    InputError
        The meshes do not come to lie on each other.
    """
    T, tree = np.eye(4), KDTree(new.vertices)
    step = max(1, len(old.vertices) // MAX_POINTS)
    points, normals = old.vertices[::step].astype(np.float64), old.normals[::step].astype(np.float64)
    for reach in REACHES:
        for _ in range(ROUNDS):
            source, target, facing = _pairs(points, normals, new, tree, T, reach)
            update = _solve(source, target, facing)
            T = update @ T
            if np.abs(update - np.eye(4)).max() < STILL:
                break
    source, target, facing = _pairs(points, normals, new, tree, T, REACHES[-1])
    fitness = len(source) / len(points)
    _check(fitness)
    rmse = float(np.sqrt((((source - target) * facing).sum(axis=1) ** 2).mean()))
    return Registration(T_new_old=T, fitness=fitness, rmse=rmse)


def moved(mesh: Mesh, T: Pose) -> Mesh:
    """A mesh in another frame; T (4, 4) takes its own to that."""
    vertices = transform(T, mesh.vertices).astype(np.float32)
    normals = (mesh.normals @ T[:3, :3].T).astype(np.float32)
    return Mesh(vertices=vertices, normals=normals, colors=mesh.colors, faces=mesh.faces)


def _pairs(points: Pose, normals: Pose, new: Mesh, tree: KDTree, T: Pose, reach: float) -> tuple[Pose, Pose, Pose]:
    """Old points in the new frame, the new vertices nearest to them, and those's normals; (N, 3) each."""
    moved = transform(T, points)
    distance, nearest = map(np.asarray, tree.query(moved, distance_upper_bound=reach))
    found = np.flatnonzero(np.isfinite(distance))
    facing = new.normals[nearest[found]].astype(np.float64)
    alike = ((normals[found] @ T[:3, :3].T) * facing).sum(axis=1) > FACING
    if alike.sum() < 6:
        _check(0.0)
    found, facing = found[alike], facing[alike]
    return moved[found], new.vertices[nearest[found]].astype(np.float64), facing


def _solve(source: Pose, target: Pose, normals: Pose) -> Pose:
    """The small rigid motion that brings points onto the planes of their partners."""
    jacobian = np.hstack([np.cross(source, normals), normals])
    off = ((source - target) * normals).sum(axis=1)
    found = least_squares(lambda x: off + jacobian @ x, np.zeros(6), loss="soft_l1", f_scale=ROBUST)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(found.x[:3]).as_matrix(), found.x[3:]
    return T


def _check(fitness: float) -> None:
    if fitness < MIN_FITNESS:
        raise InputError(
            "--align",
            expected=f"two maps of one place, {MIN_FITNESS:.0%} of whose surfaces come to lie on each other",
            found=f"{fitness:.0%}",
            advice="bring the poses of both runs into one frame to within half a metre and 10 degrees",
        )
