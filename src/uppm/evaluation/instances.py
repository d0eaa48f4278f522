"""Which submap is which true instance: counts of duplicates, fragments and right categories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.evaluation.geometry import THRESHOLD, NearestPoints
from uppm.evaluation.ground_truth import UNKNOWN, SurfaceTruth, TruthInstance
from uppm.evaluation.sampling import SurfacePart, SurfaceSamples

MIN_PIXELS = 2000
"""An instance counts as visible from so many pixels on."""
MAIN_SHARE = 0.5
"""A submap belongs to an instance that holds more than this share of its surface."""
_NOT_KNOWN = -1


@dataclass(frozen=True, kw_only=True)
class InstanceMatch:
    """One visible instance and the submaps that mainly belong to it."""

    instance: int
    name: str
    is_thing: bool
    submaps: tuple[int, ...]
    right_category: tuple[int, ...]
    """Those of `submaps` whose category is one of the instance's."""
    coverage: float
    """Share of the instance's points whose nearest reconstructed point is within 5 cm and on one of `submaps`."""


@dataclass(frozen=True, kw_only=True)
class InstanceMetrics:
    """How submaps stand to visible instances; shares from 0 to 1. None where there is nothing to divide by."""

    instances: int
    """Visible instances, things and stuff."""
    things: int
    """Visible things."""
    one_submap_ratio: float | None
    """Share of the instances that exactly one submap belongs to."""
    one_submap_ratio_things: float | None
    missed_instances: int
    """Instances that no submap belongs to."""
    unmatched_submaps: int
    """Submaps that belong to no instance, visible or not."""
    object_count_ratio: float | None
    """Object submaps / visible things."""
    fragmentation: float | None
    """Submaps an instance, over the instances that have one."""
    fragmentation_things: float | None
    category_accuracy: float | None
    """Share of the submaps that belong to a visible instance whose category is one of the instance's."""
    things_found: int
    """Visible things with a submap of a right category."""
    mean_coverage: float | None
    matches: tuple[InstanceMatch, ...]


def main_instances(
    samples: SurfaceSamples, nearest: NearestPoints, truth: SurfaceTruth, threshold: float = THRESHOLD
) -> dict[int, int]:
    """Submap id -> the instance that more than half of its points lie on (nearest point of G within 5 cm), or 0.

    -1: it lies mainly on surface whose instance is unknown, so that nothing can be said of it.
    """
    on = np.where(truth.instance == UNKNOWN, _NOT_KNOWN, truth.instance)[nearest.truth]
    instance = np.where(nearest.to_truth <= threshold, on, 0)
    parts, part = np.unique(samples.part, return_inverse=True)
    instances, column = np.unique(instance, return_inverse=True)
    counts = np.zeros((len(parts), len(instances)), dtype=np.int64)
    np.add.at(counts, (part, column), 1)
    best = counts.argmax(axis=1)
    mainly = counts.max(axis=1) > MAIN_SHARE * counts.sum(axis=1)
    return dict(zip(parts.tolist(), np.where(mainly, instances[best], 0).tolist(), strict=True))


def claimed_submaps(
    samples: SurfaceSamples, nearest: NearestPoints, threshold: float = THRESHOLD
) -> npt.NDArray[np.int32]:
    """(M,) for each point of G: the submap of the nearest reconstructed point within 5 cm, or 0."""
    return np.where(nearest.to_reconstruction <= threshold, samples.part[nearest.reconstruction], 0).astype(np.int32)


def instance_metrics(
    parts: Sequence[SurfacePart],
    samples: SurfaceSamples,
    nearest: NearestPoints,
    truth: SurfaceTruth,
    min_pixels: int = MIN_PIXELS,
) -> InstanceMetrics:
    """Match submaps to the instances that have points in G and at least `min_pixels` pixels."""
    if any(part.id < 1 for part in parts):
        raise InputError("submap ids", expected="1 or more", found="0 or less", advice="0 stands for none")
    main = main_instances(samples, nearest, truth)
    claimed = claimed_submaps(samples, nearest)
    present = set(np.unique(truth.instance).tolist())
    by_id = {part.id: part for part in parts}
    matches = tuple(
        _match(truth, number, [p for p, owner in main.items() if owner == number], by_id, claimed)
        for number in sorted(present)
        if is_visible(truth.instances.get(number), min_pixels)
    )
    objects = sum(by_id[p].is_object for p in main)
    return _summary(matches, objects=objects, unmatched=sum(owner == 0 for owner in main.values()))


def is_visible(instance: TruthInstance | None, min_pixels: int) -> bool:
    """Known, and shown by enough pixels as far as anybody counted."""
    return instance is not None and (instance.pixels is None or instance.pixels >= min_pixels)


def _match(
    truth: SurfaceTruth,
    number: int,
    submaps: list[int],
    parts: Mapping[int, SurfacePart],
    claimed: npt.NDArray[np.int32],
) -> InstanceMatch:
    instance = truth.instances[number]
    return InstanceMatch(
        instance=number,
        name=instance.name,
        is_thing=instance.is_thing,
        submaps=tuple(submaps),
        right_category=tuple(p for p in submaps if parts[p].category in instance.categories),
        coverage=float(np.isin(claimed[truth.instance == number], submaps).mean()),
    )


def _summary(matches: tuple[InstanceMatch, ...], *, objects: int, unmatched: int) -> InstanceMetrics:
    things = [m for m in matches if m.is_thing]
    found = [m for m in matches if m.submaps]
    return InstanceMetrics(
        instances=len(matches),
        things=len(things),
        one_submap_ratio=_mean([len(m.submaps) == 1 for m in matches]),
        one_submap_ratio_things=_mean([len(m.submaps) == 1 for m in things]),
        missed_instances=len(matches) - len(found),
        unmatched_submaps=unmatched,
        object_count_ratio=objects / len(things) if things else None,
        fragmentation=_mean([len(m.submaps) for m in found]),
        fragmentation_things=_mean([len(m.submaps) for m in found if m.is_thing]),
        category_accuracy=_mean([s in m.right_category for m in found for s in m.submaps]),
        things_found=sum(bool(m.right_category) for m in things),
        mean_coverage=_mean([m.coverage for m in matches]),
        matches=matches,
    )


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
