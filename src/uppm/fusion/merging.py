"""Submaps that turn out to be one object become one, by geometry and descriptors together (method.md section 4)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from uppm.core.config import FusionConfig
from uppm.core.geometry import transform
from uppm.core.types import SubmapKind
from uppm.fusion import descriptors
from uppm.fusion.resampling import combine, resample
from uppm.fusion.submaps import LiveSubmap
from uppm.fusion.tracking import least_iou
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
        best, pair = 0.0, None
        for a, b in _candidates(submaps, points):
            least = _least_overlap(a, b, similarity, row, config)
            if least > 1:
                continue
            overlap = max(volume.share_on_surface(points[a.id], b.slot), volume.share_on_surface(points[b.id], a.slot))
            if overlap >= least and overlap > best:
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
    """Pairs whose bounding boxes meet."""
    boxes = {n: (p.min(axis=0), p.max(axis=0)) for n, p in points.items() if len(p)}
    ids = sorted(boxes)
    for i, m in enumerate(ids):
        for n in ids[i + 1 :]:
            a, b = submaps[m], submaps[n]
            if (boxes[m][0] <= boxes[n][1]).all() and (boxes[n][0] <= boxes[m][1]).all():
                yield a, b


def _least_overlap(
    a: LiveSubmap, b: LiveSubmap, similarity: npt.NDArray[np.float32], row: Mapping[int, int], config: FusionConfig
) -> float:
    """Overlap at which two submaps are one: more, the less their categories agree."""
    rows = (np.array([row[s.category_id]], dtype=np.intp) for s in (a, b))
    least = least_iou(*rows, similarity, config.category_policy, config.merge_overlap, config.min_cosine)
    return float(least[0, 0])


def _merge(kept: LiveSubmap, other: LiveSubmap, volume: Volume) -> None:
    blocks = volume.gather(volume.indices(other.slot))
    if other.voxel_size != kept.voxel_size:
        blocks = resample(blocks, other.voxel_size, other.truncation, kept.voxel_size, kept.truncation)
    both = combine(volume.gather(volume.indices(kept.slot)), blocks)
    volume.replace(kept.slot, kept.voxel_size, kept.truncation, both)
    if kept.descriptor and other.descriptor:
        kept.descriptor = descriptors.merge(kept.descriptor, other.descriptor)
    if SubmapKind.OBJECT in (kept.kind, other.kind):
        kept.kind = SubmapKind.OBJECT
    kept.first_frame = min(kept.first_frame, other.first_frame)
    kept.last_frame = max(kept.last_frame, other.last_frame)
    kept.views += other.views
    kept.evidence += other.evidence
