"""Submaps that turn out to be one object become one, by geometry and descriptors together (method.md section 4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from uppm.core.config import FusionConfig
from uppm.core.geometry import invert, transform
from uppm.core.types import SubmapKind
from uppm.fusion import descriptors
from uppm.fusion.resampling import combine, resample
from uppm.fusion.submaps import LiveSubmap
from uppm.fusion.tracking import CategoryPolicy
from uppm.fusion.volume import Volume

MAX_POINTS = 4000
"""Surface points looked up for one submap of a pair."""
NEAR = 1.5
"""Voxels within which two surfaces are one: duplicates take turns in owning a surface and never share a voxel."""

SAME_BOX, PART_IN_BOX, PIECE_IN_BOX = 0.5, 0.9, 0.8
"""IoU of two objects' boxes, share of one's box in another's, and of a background piece's: from there they are one."""


def merge(kept: LiveSubmap, other: LiveSubmap, volume: Volume) -> None:
    """Make two submaps one: voxels on the kept one's grid, labels counted together. The other's slot is freed."""
    blocks = volume.gather(volume.indices(other.slot))
    T_other_kept = invert(other.T_map_submap) @ kept.T_map_submap
    if other.voxel_size != kept.voxel_size or not np.allclose(T_other_kept, np.eye(4), atol=1e-9):
        sizes = other.voxel_size, other.truncation, kept.voxel_size, kept.truncation
        blocks = resample(blocks, *sizes, T_other_kept)
    both = combine(volume.gather(volume.indices(kept.slot)), blocks)
    volume.replace(kept.slot, kept.voxel_size, kept.truncation, both)
    volume.remove(other.slot)
    if kept.descriptor and other.descriptor:
        kept.descriptor = descriptors.merge(kept.descriptor, other.descriptor)
    if SubmapKind.OBJECT in (kept.kind, other.kind):
        kept.kind = SubmapKind.OBJECT
    kept.first_frame = min(kept.first_frame, other.first_frame)
    kept.last_frame = max(kept.last_frame, other.last_frame)
    kept.views += other.views
    kept.evidence += other.evidence
    kept.companions.pop(other.id, None)


def older(a: LiveSubmap, b: LiveSubmap) -> tuple[LiveSubmap, LiveSubmap]:
    """The one to keep, which was seen more often, and the other."""
    kept, other = sorted((a, b), key=lambda s: (-s.views, s.id))
    return kept, other


def find_duplicates(
    submaps: Mapping[int, LiveSubmap], volume: Volume, policy: CategoryPolicy, config: FusionConfig
) -> Iterator[tuple[LiveSubmap, LiveSubmap]]:
    """Pairs to merge, most overlapping first; the caller merges each before it asks for the next.

    Two submaps are one where enough of either's surface lies beside the other's and their categories go together.
    """
    points = {s.id: _points(s, volume) for s in submaps.values() if s.descriptor}
    while pair := _most_overlapping(submaps, points, policy, config):
        kept, other = older(*pair)
        yield kept, other
        del points[other.id]
        points[kept.id] = _points(kept, volume)


def _points(submap: LiveSubmap, volume: Volume) -> npt.NDArray[np.float64]:
    points = transform(submap.T_map_submap, volume.surface_points(submap.slot))
    return points[:: max(1, len(points) // MAX_POINTS)]


def _most_overlapping(
    submaps: Mapping[int, LiveSubmap],
    points: Mapping[int, npt.NDArray[np.float64]],
    policy: CategoryPolicy,
    config: FusionConfig,
) -> tuple[LiveSubmap, LiveSubmap] | None:
    best, found = 0.0, None
    for a, b in _neighbours(submaps, points):
        least = policy.least_overlap([a.category_id], [b.category_id], config.merge_overlap)[0, 0]
        if least > 1:
            continue
        near = NEAR * max(a.voxel_size, b.voxel_size)
        overlap = max(_share_near(points[a.id], points[b.id], near), _share_near(points[b.id], points[a.id], near))
        if a.category_id == b.category_id and _fill_one_box(a, b, points[a.id], points[b.id]):
            overlap = max(overlap, 1.0)
        if overlap >= least and overlap > best:
            best, found = overlap, (a, b)
    return found


def _neighbours(
    submaps: Mapping[int, LiveSubmap], points: Mapping[int, npt.NDArray[np.float64]]
) -> Iterator[tuple[LiveSubmap, LiveSubmap]]:
    """Pairs whose bounding boxes meet."""
    boxes = {n: (p.min(axis=0), p.max(axis=0)) for n, p in points.items() if len(p)}
    ids = sorted(boxes)
    for i, m in enumerate(ids):
        for n in ids[i + 1 :]:
            if (boxes[m][0] <= boxes[n][1]).all() and (boxes[n][0] <= boxes[m][1]).all():
                yield submaps[m], submaps[n]


def _fill_one_box(
    a: LiveSubmap, b: LiveSubmap, points_a: npt.NDArray[np.float64], points_b: npt.NDArray[np.float64]
) -> bool:
    """Whether two submaps of one category are the same thing by the boxes that they fill.

    The two sides of a door frame share no surface. Objects are one where their boxes agree or the smaller lies in the
    larger; background is where most of the smaller does, as a piece of a room's walls does in the others.
    """
    margin = 2 * max(a.voxel_size, b.voxel_size)
    low = np.stack([points_a.min(axis=0), points_b.min(axis=0)]) - margin
    high = np.stack([points_a.max(axis=0), points_b.max(axis=0)]) + margin
    volumes = np.prod(high - low, axis=1)
    common = np.prod(np.maximum(high.min(axis=0) - low.max(axis=0), 0))
    if SubmapKind.OBJECT in (a.kind, b.kind):
        return bool(common >= min(SAME_BOX * (volumes.sum() - common), PART_IN_BOX * volumes.min()))
    return bool(common >= PIECE_IN_BOX * volumes.min())


def _share_near(points: npt.NDArray[np.float64], others: npt.NDArray[np.float64], distance: float) -> float:
    """Share of points (N, 3) with one of the others (M, 3) within a distance."""
    return float(np.isfinite(KDTree(others).query(points, distance_upper_bound=distance)[0]).mean())
