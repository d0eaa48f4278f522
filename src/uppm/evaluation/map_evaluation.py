"""Map-to-map: one reconstruction against the ground truth of a sequence."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from uppm.evaluation.checks import check_comparable
from uppm.evaluation.geometry import GeometricMetrics, geometric_metrics, nearest_points
from uppm.evaluation.ground_truth import SurfaceTruth
from uppm.evaluation.instances import MIN_PIXELS, InstanceMetrics, instance_metrics
from uppm.evaluation.panmap_metrics import PanmapMetrics, TsdfLayer, panmap_metrics
from uppm.evaluation.sampling import SurfacePart, sample_parts
from uppm.evaluation.surface_panoptic import SurfacePanopticMetrics, surface_overlaps, surface_panoptic_metrics


@dataclass(frozen=True, kw_only=True, eq=False)
class Reconstruction:
    """What is compared with the ground truth."""

    source: str
    parts: tuple[SurfacePart, ...]
    layers: tuple[TsdfLayer, ...] = ()
    """The parts' voxels, where it is a map."""


METRIC_GROUPS = ("geometry", "instances", "panoptic", "panmap")
"""Fields of `MapEvaluation` whose own fields are the metrics."""


@dataclass(frozen=True, kw_only=True)
class MapEvaluation:
    """What `uppm evaluate map` says of one map or mesh."""

    source: str
    ground_truth: str
    points_per_m2: float
    seed: int
    reconstruction_points: int
    ground_truth_points: int
    geometry: GeometricMetrics
    instances: InstanceMetrics | None
    """None for a mesh whose submaps are not told apart."""
    panoptic: SurfacePanopticMetrics | None
    """Likewise."""
    panmap: PanmapMetrics | None
    """None for a mesh: these ask voxels."""

    def to_dict(self) -> dict[str, Any]:
        """Flat, as `--json` prints it (docs/evaluation.md)."""
        nested = asdict(self)
        groups = [nested.pop(name) or {} for name in METRIC_GROUPS]
        return nested | {key: value for group in groups for key, value in group.items()}


def evaluate_map(
    reconstruction: Reconstruction,
    truth: SurfaceTruth,
    *,
    points_per_m2: float = 10_000,
    seed: int = 0,
    min_pixels: int = MIN_PIXELS,
) -> MapEvaluation:
    """Sample the parts' surfaces and measure them; raises `InputError` where they cannot be of the truth's scene."""
    parts, source, layers = reconstruction.parts, reconstruction.source, reconstruction.layers
    vertices = np.concatenate([part.mesh.vertices for part in parts] or [np.empty((0, 3))])
    check_comparable(vertices, truth.points, source, truth.source)
    samples = sample_parts(parts, points_per_m2, seed, source=source)
    nearest = nearest_points(samples.points, truth.points)
    told_apart = any(part.category is not None for part in parts)
    table = surface_overlaps(parts, samples, nearest, truth) if told_apart else None
    return MapEvaluation(
        source=source,
        ground_truth=truth.source,
        points_per_m2=points_per_m2,
        seed=seed,
        reconstruction_points=len(samples.points),
        ground_truth_points=len(truth.points),
        geometry=geometric_metrics(nearest, truth.foreground),
        instances=instance_metrics(parts, samples, nearest, truth, min_pixels) if told_apart else None,
        panoptic=surface_panoptic_metrics(table, truth) if table else None,
        panmap=panmap_metrics(layers, vertices, truth.points) if layers else None,
    )
