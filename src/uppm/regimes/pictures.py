"""Where a reconstruction is wrong, as pictures: distances, what is missed, and wrong instances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from uppm.core.types import Mesh
from uppm.evaluation.error_colors import FOUND, MISSED, InstanceError, distance_colors, instance_colors
from uppm.evaluation.geometry import THRESHOLD
from uppm.evaluation.ground_truth import SurfaceTruth
from uppm.evaluation.instances import main_instances
from uppm.evaluation.map_evaluation import Comparison
from uppm.map.mesh import merged
from uppm.map.render import View, choose_view, render

Image = npt.NDArray[np.uint8]

WIDTH, HEIGHT = 1200, 750
SPLAT = 0.012
"""Metres from the middle of a point's square to its sides."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorPictures:
    """(H, W, 3) RGB each, one view."""

    distance: Image
    """Blue where it is exact, red from 5 cm on."""
    missed: Image
    """Red: ground truth without any reconstruction within 5 cm."""
    instances: Image | None
    """Colours of `InstanceError`; None where parts are not told apart."""


def draw_errors(comparison: Comparison) -> ErrorPictures:
    """Pictures of one comparison, all from the same place."""
    drawing = _Drawing.of(comparison)
    truth = comparison.truth
    lost = comparison.nearest.to_reconstruction > THRESHOLD
    ghost = replace(drawing.mesh, colors=np.full_like(drawing.mesh.colors, FOUND))
    missed = merged([ghost, splats(truth.points[lost], drawing.view, MISSED)])
    return ErrorPictures(
        distance=drawing.colored(distance_colors(drawing.distance)),
        missed=drawing.seen(missed),
        instances=_instances(comparison, drawing) if comparison.reconstruction.is_told_apart else None,
    )


def draw_instances(comparison: Comparison) -> Image:
    """The last of the pictures alone: right and wrong instances."""
    return _instances(comparison, _Drawing.of(comparison))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Drawing:
    """All parts as one mesh, and where its vertices lie in the ground truth."""

    mesh: Mesh
    part: npt.NDArray[np.int64]
    """(V,) id of each vertex's part."""
    distance: npt.NDArray[np.float64]
    """(V,) to the nearest true point, metres."""
    nearest: npt.NDArray[np.intp]
    """(V,) which one that is."""
    view: View
    fit: npt.NDArray[np.float64]
    """(N, 3), frame map: what is to be in every picture, reconstructed and true."""

    @classmethod
    def of(cls, comparison: Comparison) -> _Drawing:
        points, parts = comparison.truth.points, comparison.reconstruction.parts
        meshes = [_surface(part.mesh) for part in parts]
        mesh = merged(meshes)
        distance, index = comparison.truth.index.nearest(mesh.vertices.astype(np.float64))
        view = choose_view(np.stack([points.min(axis=0), points.max(axis=0)]), up_of(comparison.truth))
        part = np.repeat([part.id for part in parts], [len(mesh.vertices) for mesh in meshes])
        fit = np.concatenate([mesh.vertices.astype(np.float64), points])
        return cls(mesh=mesh, part=part, distance=distance, nearest=index, view=view, fit=fit)

    def colored(self, colors: Image) -> Image:
        """A picture with a colour for each vertex."""
        return self.seen(replace(self.mesh, colors=colors))

    def seen(self, mesh: Mesh) -> Image:
        """A mesh from the place that all pictures are taken from."""
        return render(mesh, self.view, width=WIDTH, height=HEIGHT, fit=self.fit).image


def _instances(comparison: Comparison, drawing: _Drawing) -> Image:
    truth, parts = comparison.truth, comparison.reconstruction.parts
    instance = np.where(drawing.distance <= THRESHOLD, truth.instance[drawing.nearest], 0)
    owners = main_instances(comparison.samples, comparison.nearest, truth)
    categories = {part.id: part.category for part in parts}
    return drawing.colored(instance_colors(categories, drawing.part, instance, owners, truth.instances))


def legend_of_instances() -> Mapping[tuple[int, int, int], str]:
    """Colour -> what it means."""
    return {error.value: error.meaning for error in InstanceError}


def splats(points: npt.NDArray[np.floating], view: View, color: tuple[int, int, int]) -> Mesh:
    """A small square facing the viewer for each point (N, 3)."""
    right, down, forward = view.R_view_map
    corners = SPLAT * np.stack([-right - down, -right + down, right + down, right - down])
    vertices = (points[:, None] + corners).reshape(-1, 3).astype(np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(len(points))[:, None, None]
    return Mesh(
        vertices=vertices,
        normals=np.broadcast_to(-forward, vertices.shape).astype(np.float32),
        colors=np.broadcast_to(np.array(color, dtype=np.uint8), vertices.shape).copy(),
        faces=faces.reshape(-1, 3).astype(np.int32),
    )


def up_of(truth: SurfaceTruth) -> npt.NDArray[np.float64]:
    """(3,) unit vector against gravity: the normal of the floors, towards everything else; +z without floors."""
    floors = [i.id for i in truth.instances.values() if any("floor" in name for name in i.categories)]
    points = truth.points[np.isin(truth.instance, floors)]
    if len(points) < 3:
        return np.array([0.0, 0.0, 1.0])
    centre = points.mean(axis=0)
    normal = np.linalg.svd(np.cov((points - centre).T))[0][:, -1]
    return normal * (np.sign(normal @ (truth.points.mean(axis=0) - centre)) or 1.0)


def _surface(mesh: Mesh) -> Mesh:
    """The mesh with normals, which other systems' files need not have; a point cloud becomes small squares."""
    if not len(mesh.faces):
        down = View(R_view_map=np.diag([1.0, -1.0, -1.0]))
        return splats(mesh.vertices, down, (160, 160, 160))
    if mesh.normals.any():
        return mesh
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], normal)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(mesh, normals=normals / np.maximum(length, 1e-12))
