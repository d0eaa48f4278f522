"""Map-to-map: one reconstruction against the ground truth of a sequence."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from uppm.core.geometry import transform
from uppm.core.types import Mesh
from uppm.evaluation.alignment import Alignment, find_misalignment
from uppm.evaluation.checks import check_comparable
from uppm.evaluation.geometry import GeometricMetrics, NearestPoints, geometric_metrics, nearest_points
from uppm.evaluation.ground_truth import UNKNOWN, SurfaceTruth
from uppm.evaluation.instances import MIN_PIXELS, InstanceMetrics, instance_metrics
from uppm.evaluation.normals import accuracy_along_normal
from uppm.evaluation.panmap_metrics import PanmapMetrics, TsdfLayer, panmap_metrics
from uppm.evaluation.panoptic_metrics import PanopticMetrics, panoptic_metrics
from uppm.evaluation.sampling import SurfacePart, SurfaceSamples, sample_parts
from uppm.evaluation.surface_panoptic import surface_overlaps

FAR = 0.25
"""Metres from which on a point of R is where the ground truth does not reach."""
MAX_FAR_SHARE = 0.1
"""Share of R that may be so before it is said."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reconstruction:
    """What is compared with the ground truth."""

    source: str
    parts: tuple[SurfacePart, ...]
    layers: tuple[TsdfLayer, ...] = ()
    """The parts' voxels, where it is a map."""

    @property
    def is_told_apart(self) -> bool:
        """Its parts are instances with categories; a map's are, even if none got a category."""
        return bool(self.layers) or any(part.category is not None for part in self.parts)


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """A reconstruction beside the ground truth, before anything is measured."""

    reconstruction: Reconstruction
    truth: SurfaceTruth
    points_per_m2: float
    seed: int
    samples: SurfaceSamples
    nearest: NearestPoints
    misalignment: Alignment | None
    """The motion between the two frames, where one was found."""
    aligned: bool
    """The reconstruction was moved by it."""


METRIC_GROUPS = ("geometry", "instances", "panoptic", "panmap")
"""Fields of `MapEvaluation` whose own fields are the metrics."""
_IN_2D = re.compile(r"^([prs]q)")
"""Quality on points is printed as `pq_3d`, so that nobody takes it for that of 2D frames."""


@dataclass(frozen=True, kw_only=True)
class MapEvaluation:
    """What `uppm evaluate map` says of one map or mesh."""

    source: str
    ground_truth: str
    points_per_m2: float
    seed: int
    reconstruction_points: int
    ground_truth_points: int
    aligned: bool
    """The reconstruction was moved onto the ground truth before it was measured."""
    misalignment_cm: float | None
    """How far its points had, or have, to move, root mean square; None: the frames agree."""
    misalignment_deg: float | None
    notes: tuple[str, ...]
    """What a reader of the figures must know."""
    accuracy_along_normal_cm: float
    geometry: GeometricMetrics
    instances: InstanceMetrics | None
    """None for a mesh whose submaps are not told apart."""
    classes_excluded: int
    """Classes that the ground truth names and has no point of: in no mean."""
    panoptic: PanopticMetrics | None
    """Likewise."""
    panmap: PanmapMetrics | None
    """None for a mesh: these ask voxels."""

    def to_dict(self) -> dict[str, Any]:
        """Flat, as `--json` prints it (docs/evaluation.md)."""
        nested = asdict(self)
        if self.panoptic is None:
            del nested["classes_excluded"]
        groups = {name: nested.pop(name) or {} for name in METRIC_GROUPS}
        groups["panoptic"] = {_IN_2D.sub(r"\1_3d", key): value for key, value in groups["panoptic"].items()}
        return nested | {key: value for group in groups.values() for key, value in group.items()}


def evaluate_map(
    reconstruction: Reconstruction,
    truth: SurfaceTruth,
    *,
    points_per_m2: float = 10_000,
    seed: int = 0,
    min_pixels: int = MIN_PIXELS,
    align: bool = False,
) -> MapEvaluation:
    """Compare and measure; raises `InputError` where the two cannot be of one scene."""
    return measure(compare(reconstruction, truth, points_per_m2=points_per_m2, seed=seed, align=align), min_pixels)


def compare(
    reconstruction: Reconstruction,
    truth: SurfaceTruth,
    *,
    points_per_m2: float = 10_000,
    seed: int = 0,
    align: bool = False,
) -> Comparison:
    """Sample the parts' surfaces and find the nearest points both ways.

    Parameters
    ----------
    align : move the reconstruction onto the ground truth where their frames differ by a rigid motion.
    """
    vertices = np.concatenate([part.mesh.vertices for part in reconstruction.parts] or [np.empty((0, 3))])
    check_comparable(vertices, truth.points, reconstruction.source, truth.source)
    samples = sample_parts(reconstruction.parts, points_per_m2, seed, source=reconstruction.source)
    misalignment = find_misalignment(samples.points, truth.points, seed)
    if align and misalignment is not None:
        reconstruction = moved(reconstruction, misalignment.T_truth_map)
        samples = sample_parts(reconstruction.parts, points_per_m2, seed, source=reconstruction.source)
    return Comparison(
        reconstruction=reconstruction,
        truth=truth,
        points_per_m2=points_per_m2,
        seed=seed,
        samples=samples,
        nearest=nearest_points(samples.points, truth.index),
        misalignment=misalignment,
        aligned=align and misalignment is not None,
    )


def measure(comparison: Comparison, min_pixels: int = MIN_PIXELS) -> MapEvaluation:
    """All metrics of one comparison."""
    c, parts, off = comparison, comparison.reconstruction.parts, comparison.misalignment
    instances = panoptic = panmap = None
    if c.reconstruction.is_told_apart:
        instances = instance_metrics(parts, c.samples, c.nearest, c.truth, min_pixels)
        panoptic = panoptic_metrics([surface_overlaps(parts, c.samples, c.nearest, c.truth)])
    if c.reconstruction.layers:
        vertices = np.concatenate([part.mesh.vertices for part in parts])
        panmap = panmap_metrics(c.reconstruction.layers, vertices, c.truth.index)
    return MapEvaluation(
        source=c.reconstruction.source,
        ground_truth=c.truth.source,
        points_per_m2=c.points_per_m2,
        seed=c.seed,
        reconstruction_points=len(c.samples.points),
        ground_truth_points=len(c.truth.points),
        aligned=c.aligned,
        misalignment_cm=off.shift_cm if off else None,
        misalignment_deg=off.rotation_deg if off else None,
        notes=tuple(_notes(c)),
        accuracy_along_normal_cm=accuracy_along_normal(c.samples.points, c.truth.index, c.nearest, c.seed),
        geometry=geometric_metrics(c.nearest, c.truth.foreground),
        instances=instances,
        classes_excluded=len(c.truth.classes_without_points),
        panoptic=panoptic,
        panmap=panmap,
    )


def moved(reconstruction: Reconstruction, T: np.ndarray) -> Reconstruction:
    """The reconstruction in another frame; T (4, 4) takes its own to that."""

    def mesh(mesh: Mesh) -> Mesh:
        vertices = transform(T, mesh.vertices).astype(np.float32)
        return replace(mesh, vertices=vertices, normals=(mesh.normals @ T[:3, :3].T).astype(np.float32))

    parts = tuple(replace(part, mesh=mesh(part.mesh)) for part in reconstruction.parts)
    layers = tuple(replace(layer, T_map_submap=T @ layer.T_map_submap) for layer in reconstruction.layers)
    return replace(reconstruction, parts=parts, layers=layers)


def _notes(comparison: Comparison) -> list[str]:
    notes, off = [], comparison.misalignment
    if off is not None:
        done = "it was moved there" if comparison.aligned else "measure with --align, or bring both into one frame"
        notes.append(
            f"the frames differ by a rigid motion of {off.shift_cm:.1f} cm and {off.rotation_deg:.1f} degrees, which "
            f"brings the mean distance from {off.before_cm:.1f} to {off.after_cm:.1f} cm: {done}"
        )
    far = float(np.mean(comparison.nearest.to_truth > FAR))
    if far > MAX_FAR_SHARE:
        notes.append(
            f"{far:.0%} of the reconstruction is more than 25 cm from any ground truth, which does not cover it: cut "
            "it to what the cameras saw within range, or name its own sequence"
        )
    return notes + _notes_on(comparison.truth)


def _notes_on(truth: SurfaceTruth) -> list[str]:
    notes = []
    if not truth.is_observed:
        notes.append("the ground truth is a whole scan: without its frames nobody knows what the cameras saw")
    unknown = float(np.mean(truth.instance == UNKNOWN))
    if unknown:
        labels = f"; labels without a unified category: {', '.join(truth.unmapped)}" if truth.unmapped else ""
        notes.append(f"{unknown:.0%} of the ground truth is of unknown instances, left out of panoptic figures{labels}")
    return notes
