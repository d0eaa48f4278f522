"""Submaps that turn out to be one object become one, by geometry and descriptors together (method.md section 4)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from uppm.core.config import FusionConfig
from uppm.core.geometry import transform
from uppm.fusion import descriptors
from uppm.fusion.resampling import combine, resample
from uppm.fusion.submaps import LiveSubmap
from uppm.fusion.volume import Volume

MAX_POINTS = 4000
"""Surface points looked up for one submap of a pair."""


def merge_duplicates(
    submaps: dict[int, LiveSubmap],
    volume: Volume,
    similarity: npt.NDArray[np.float32],
    row: Mapping[int, int],
    config: FusionConfig,
    dropped: Counter[str],
) -> None:
    """Merge each pair of submaps that overlap and whose categories go together, most overlapping pair first.

    submaps and dropped are changed. similarity (C, C): cosine of category embeddings; row: category id -> its row.
    """
    points = {s.id: _points(s, volume) for s in submaps.values() if s.descriptor}
    while True:
        best, pair = config.merge_overlap, None
        for a, b in _candidates(submaps, points):
            if not _compatible(a, b, similarity, row, config):
                continue
            overlap = max(volume.share_on_surface(points[a.id], b.slot), volume.share_on_surface(points[b.id], a.slot))
            if overlap > best:
                best, pair = overlap, (a, b)
        if pair is None:
            return
        kept, other = sorted(pair, key=lambda s: (-s.views, s.id))
        _merge(kept, other, volume)
        volume.remove(other.slot)
        del submaps[other.id], points[other.id]
        points[kept.id] = _points(kept, volume)
        dropped["duplicate submap merged"] += 1


def _points(submap: LiveSubmap, volume: Volume) -> npt.NDArray[np.float64]:
    points = transform(submap.T_map_submap, volume.surface_points(submap.slot))
    return points[:: max(1, len(points) // MAX_POINTS)]


def _candidates(submaps: Mapping[int, LiveSubmap], points: Mapping[int, npt.NDArray[np.float64]]):
    """Pairs of one kind whose bounding boxes meet."""
    boxes = {n: (p.min(axis=0), p.max(axis=0)) for n, p in points.items() if len(p)}
    ids = sorted(boxes)
    for i, m in enumerate(ids):
        for n in ids[i + 1 :]:
            a, b = submaps[m], submaps[n]
            meet = (boxes[m][0] <= boxes[n][1]).all() and (boxes[n][0] <= boxes[m][1]).all()
            if a.kind is b.kind and meet:
                yield a, b


def _compatible(
    a: LiveSubmap, b: LiveSubmap, similarity: npt.NDArray[np.float32], row: Mapping[int, int], config: FusionConfig
) -> bool:
    if a.category_id == b.category_id or config.category_policy == "any":
        return True
    cosine = similarity[row[a.category_id], row[b.category_id]]
    return config.category_policy == "compatible" and cosine >= config.min_cosine


def _merge(kept: LiveSubmap, other: LiveSubmap, volume: Volume) -> None:
    blocks = volume.gather(volume.indices(other.slot))
    if other.voxel_size != kept.voxel_size:
        blocks = resample(blocks, other.voxel_size, other.truncation, kept.voxel_size, kept.truncation)
    both = combine(volume.gather(volume.indices(kept.slot)), blocks)
    volume.replace(kept.slot, kept.voxel_size, kept.truncation, both)
    if kept.descriptor and other.descriptor:
        kept.descriptor = descriptors.merge(kept.descriptor, other.descriptor)
    kept.first_frame = min(kept.first_frame, other.first_frame)
    kept.last_frame = max(kept.last_frame, other.last_frame)
    kept.views += other.views
    kept.evidence += other.evidence
