"""Submaps that turn out to be one object become one, by geometry and descriptors together (method.md section 4)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from uppm._kernels.hashing import NONE
from uppm.core.config import FusionConfig
from uppm.core.geometry import invert, transform
from uppm.core.types import VOXELS_PER_SIDE, SubmapKind, SubmapState, VoxelBlocks
from uppm.fusion import descriptors
from uppm.fusion.resampling import FULL, combine, resample
from uppm.fusion.submaps import LiveSubmap
from uppm.fusion.tracking import CategoryPolicy
from uppm.fusion.volume import Volume

MAX_POINTS = 4000
"""Surface points looked up for one submap of a pair."""
NEAR = 1.5
"""Voxels within which two surfaces are one: duplicates take turns in owning a surface and never share a voxel."""

MIN_POINTS, MIN_SHARE = 20, 0.02
"""Points, and share of them, by which two submaps agree or conflict."""

SAME_BOX, PART_IN_BOX, PIECE_IN_BOX = 0.5, 0.9, 0.8
"""IoU of two objects' boxes, share of one's box in another's, and of a background piece's: from there they are one."""


def merge(kept: LiveSubmap, other: LiveSubmap, volume: Volume) -> None:
    """Make two submaps one: voxels on the kept one's grid, labels counted together. The other's slot is freed."""
    blocks = volume.gather(volume.indices(other.slot))
    T_other_kept = invert(other.T_map_submap) @ kept.T_map_submap
    if other.voxel_size != kept.voxel_size or not np.allclose(T_other_kept, np.eye(4), atol=1e-9):
        sizes = other.voxel_size, other.truncation, kept.voxel_size, kept.truncation
        blocks = resample(blocks, *sizes, T_other_kept)
    shared = volume.find(kept.slot, blocks.coords)
    volume.put(kept.slot, combine(volume.gather(shared[shared != NONE]), blocks))
    volume.remove(other.slot)
    if kept.descriptor and other.descriptor:
        kept.descriptor = descriptors.merge(kept.descriptor, other.descriptor)
    if SubmapKind.OBJECT in (kept.kind, other.kind):
        kept.kind = SubmapKind.OBJECT
    if kept.state is not other.state:
        # One of the two was confirmed: an inactive one was, before.
        kept.state = SubmapState.CONFIRMED
    kept.misses = min(kept.misses, other.misses)
    kept.first_frame = min(kept.first_frame, other.first_frame)
    kept.last_frame = max(kept.last_frame, other.last_frame)
    kept.views += other.views
    kept.evidence += other.evidence
    kept.forget_parts()


def older(a: LiveSubmap, b: LiveSubmap) -> tuple[LiveSubmap, LiveSubmap]:
    """The one to keep, which was seen more often, and the other."""
    kept, other = sorted((a, b), key=lambda s: (-s.views, s.id))
    return kept, other


def count_together(a: LiveSubmap, b: LiveSubmap, frames: int) -> int:
    """Count frames in which one segment covered both submaps; less than none where each had a segment of its own.

    Returns the balance of all frames so far, which the older of the two keeps.
    """
    first, second = (a, b) if a.id < b.id else (b, a)
    first.companions[second.id] = first.companions.get(second.id, 0) + frames
    return first.companions[second.id]


def together(a: LiveSubmap, b: LiveSubmap) -> int:
    """Frames in which one segment covered both submaps, less those in which each had a segment of its own."""
    return a.companions.get(b.id, 0) + b.companions.get(a.id, 0)


def inherit(kept: LiveSubmap, other: LiveSubmap, submaps: Iterable[LiveSubmap]) -> None:
    """What was counted of a submap and others is the kept one's now."""
    for submap in submaps:
        frames = submap.companions.pop(other.id, 0) + other.companions.get(submap.id, 0)
        if frames and submap is not kept:
            count_together(kept, submap, frames)


@dataclass(frozen=True, kw_only=True)
class Likeness:
    """How far two submaps are one, by geometry and descriptors together.

    `overlap`: enough of either's surface lies beside the other's, or both fill one box; the less their categories
    agree, the more is asked for. `agreement`: the test of Panoptic Multi-TSDFs, surface points looked up in voxels.
    Two that frames showed apart are not one, `merge_frames` of them more than showed both under one segment.
    """

    volume: Volume
    policy: CategoryPolicy
    config: FusionConfig

    def points(self, submap: LiveSubmap) -> npt.NDArray[np.float64]:
        """Points (N, 3) of a submap's surface, frame map; a few thousand at most."""
        points = transform(submap.T_map_submap, self.volume.surface_points(submap.slot))
        return points[:: max(1, len(points) // MAX_POINTS)]

    def __call__(
        self, a: LiveSubmap, b: LiveSubmap, points_a: npt.NDArray[np.float64], points_b: npt.NDArray[np.float64]
    ) -> float:
        """0 where the two are not one; the greater, the likelier."""
        frames = self.config.merge_frames
        if frames is not None and together(a, b) <= -frames:
            return 0.0
        least = self.policy.least_overlap([a.category_id], [b.category_id], self.config.merge_overlap)[0, 0]
        if self.config.merge_by == "agreement":
            if not np.isfinite(least):
                return 0.0
            return max(_agreement(points_a, b, self.volume), _agreement(points_b, a, self.volume))
        if least > 1:
            return 0.0
        near = NEAR * max(a.voxel_size, b.voxel_size)
        overlap = max(_share_near(points_a, points_b, near), _share_near(points_b, points_a, near))
        if a.category_id == b.category_id and _fill_one_box(a, b, points_a, points_b):
            overlap = max(overlap, 1.0)
        return overlap if overlap >= least else 0.0


def find_duplicates(submaps: Mapping[int, LiveSubmap], likeness: Likeness) -> Iterator[tuple[LiveSubmap, LiveSubmap]]:
    """Pairs to merge, likeliest first; the caller merges each before it asks for the next."""
    points = {s.id: likeness.points(s) for s in submaps.values() if s.descriptor}
    while pair := _likeliest(((submaps[m], submaps[n]) for m, n in _neighbours(points)), points, likeness):
        kept, other = older(*pair)
        yield kept, other
        del points[other.id]
        points[kept.id] = likeness.points(kept)


def find_duplicate(submap: LiveSubmap, others: Sequence[LiveSubmap], likeness: Likeness) -> LiveSubmap | None:
    """The one of the others that is likeliest the same as a submap; None where none is."""
    points = {s.id: likeness.points(s) for s in (submap, *others)}
    by_id = {s.id: s for s in others}
    meet = {m if n == submap.id else n for m, n in _neighbours(points) if submap.id in (m, n)}
    pair = _likeliest(((submap, by_id[n]) for n in sorted(meet)), points, likeness)
    return pair[1] if pair else None


def _likeliest(
    pairs: Iterable[tuple[LiveSubmap, LiveSubmap]],
    points: Mapping[int, npt.NDArray[np.float64]],
    likeness: Likeness,
) -> tuple[LiveSubmap, LiveSubmap] | None:
    best, found = 0.0, None
    for a, b in pairs:
        value = likeness(a, b, points[a.id], points[b.id])
        if value > best:
            best, found = value, (a, b)
    return found


def _neighbours(points: Mapping[int, npt.NDArray[np.float64]]) -> Iterator[tuple[int, int]]:
    """Ids of pairs whose bounding boxes meet."""
    boxes = {n: (p.min(axis=0), p.max(axis=0)) for n, p in points.items() if len(p)}
    ids = sorted(boxes)
    for i, m in enumerate(ids):
        for n in ids[i + 1 :]:
            if (boxes[m][0] <= boxes[n][1]).all() and (boxes[n][0] <= boxes[m][1]).all():
                yield m, n


def _agreement(points: npt.NDArray[np.float64], other: LiveSubmap, volume: Volume) -> float:
    """Share of a submap's surface points (N, 3), frame map, that lie on another's surface; 0 where the two conflict.

    A point agrees within a voxel of the other's surface, and conflicts where it lies deeper behind it; each counts
    above 20 points and 2 %, as in Panoptic Multi-TSDFs.
    """
    at = transform(invert(other.T_map_submap), points) / other.voxel_size
    distance, belongs, foreign = _look_up(np.floor(at).astype(np.int64), volume.gather(volume.indices(other.slot)))
    one_voxel = FULL * other.voxel_size / other.truncation
    conflicts = (~foreign & (distance < -one_voxel)).sum()
    agrees = (belongs & (np.abs(distance) <= one_voxel)).sum()
    limit = max(MIN_POINTS, MIN_SHARE * len(points))
    return float(agrees / len(points)) if agrees > limit >= conflicts else 0.0


def _look_up(
    voxels: npt.NDArray[np.int64], blocks: VoxelBlocks
) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Distance (N,) at voxel coordinates (N, 3); whether a voxel belongs; whether it is another's or not observed."""
    row = {tuple(c): n for n, c in enumerate(blocks.coords.tolist())}
    found = np.array([row.get(tuple(c), -1) for c in (voxels // VOXELS_PER_SIDE).tolist()], dtype=np.intp)
    at = (found, *(voxels % VOXELS_PER_SIDE).T)
    own, known = blocks.belonging[at], (found >= 0) & (blocks.weight[at] > 0)
    foreign = own[:, 0] < own[:, 1]
    return blocks.distance[at], known & (own[:, 0] > 0) & ~foreign, ~known | foreign


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
