"""The life of a submap: tentative, confirmed, inactive, removed; judged by views and evidence (method.md section 4)."""

from __future__ import annotations

import numpy as np

from uppm.core.config import FusionConfig
from uppm.core.types import SubmapState
from uppm.fusion.submaps import LiveSubmap


def seen(submap: LiveSubmap, frame: int, score: float, config: FusionConfig) -> None:
    """An observation was associated: it counts its score as evidence, and may confirm or wake the submap."""
    submap.views += 1
    submap.misses = 0
    submap.last_frame = frame
    submap.evidence += score
    if submap.state is SubmapState.INACTIVE or submap.evidence >= config.confirm_evidence:
        submap.state = SubmapState.CONFIRMED


def missed(submap: LiveSubmap, measured: int, seen_through: int, config: FusionConfig) -> bool:
    """The submap was in view and nothing was associated. Returns whether it is to be removed.

    measured, seen_through: its surface voxels that the depth confirms, and that it contradicts. A view of fewer than
    `min_expected` voxels says nothing.
    """
    if measured + seen_through < config.min_expected:
        return False
    submap.misses += 1
    submap.evidence -= 1.0 if seen_through > measured else config.miss_penalty
    if submap.state is SubmapState.TENTATIVE:
        return submap.misses > config.max_misses or submap.evidence < 0
    if submap.misses > config.max_misses:
        submap.state = SubmapState.INACTIVE
    return False


def believed(submap: LiveSubmap, config: FusionConfig) -> bool:
    """Whether the evidence for a submap, less what spoke against it, is enough at the end."""
    return submap.state is not SubmapState.TENTATIVE and submap.evidence >= config.confirm_evidence


def vote_weight(score: float, depth: float, config: FusionConfig) -> float:
    """Weight of an observation's vote: one, or its score, less with distance beyond 2 m."""
    if config.votes == "count":
        return 1.0
    return float(max(score, 0.05) * min(1.0, 2.0 / max(depth, 1e-3)))


def min_pixels(voxel_size: float, depth: float, focal_area: float, config: FusionConfig) -> int:
    """Pixels that a segment needs to found a submap: its area at its depth covers `min_area` voxel faces.

    So a cup needs less than a bed, at any image size. focal_area: fx * fy; depth: the segment's mean, metres.
    """
    area = config.min_area * voxel_size**2
    return int(np.ceil(area * focal_area / max(depth, 1e-3) ** 2))
