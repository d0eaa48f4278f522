"""The life of a submap: tentative, confirmed, inactive, removed; judged by views and evidence (method.md section 4)."""

from __future__ import annotations

import numpy as np

from uppm.core.config import FusionConfig
from uppm.core.types import Intrinsics, SubmapState
from uppm.fusion.submaps import LiveSubmap


def seen(submap: LiveSubmap, frame: int, score: float, config: FusionConfig) -> None:
    """An observation was associated: it counts its score as evidence, and may confirm or wake the submap."""
    submap.views += not submap.views or submap.last_frame != frame
    submap.misses = 0
    submap.last_frame = frame
    submap.evidence += score
    by_count = submap.views > config.confirm_frames
    enough = by_count if config.life_cycle == "count" else submap.evidence >= config.confirm_evidence
    if submap.state is SubmapState.INACTIVE or enough:
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


def unseen(submap: LiveSubmap, config: FusionConfig) -> bool:
    """A frame went by without the submap, in view or not. Returns whether it is to be removed.

    The rule of Panoptic Multi-TSDFs: a new submap is seen in each of the next frames or deleted, and becomes inactive
    after `max_misses` frames without it.
    """
    if submap.state is SubmapState.TENTATIVE:
        return True
    submap.misses += 1
    if submap.misses >= config.max_misses:
        submap.state = SubmapState.INACTIVE
    return False


def believed(submap: LiveSubmap, config: FusionConfig) -> bool:
    """Whether the evidence for a submap, less what spoke against it, is enough at the end; counting keeps all.

    Where frames are counted, the end makes every submap inactive, as in Panoptic Multi-TSDFs.
    """
    if config.life_cycle == "count":
        submap.state = SubmapState.INACTIVE
        return True
    return submap.state is not SubmapState.TENTATIVE and submap.evidence >= config.confirm_evidence


def vote_weight(score: float, depth: float, config: FusionConfig, *, first: bool) -> float:
    """Weight of an observation's vote: its score, less with distance beyond 2 m; or one; or one for the first alone."""
    if config.votes != "weighted":
        return float(first or config.votes == "count")
    return float(max(score, 0.05) * min(1.0, 2.0 / max(depth, 1e-3)))


def min_pixels(voxel_size: float, depth: float, intrinsics: Intrinsics, config: FusionConfig) -> int:
    """Pixels that a segment needs to found a submap: its area at its depth covers `min_area` voxel faces.

    So a cup needs less than a bed, at any image size; at least `min_pixels` of a 640x480 image. depth: the segment's
    mean, metres.
    """
    area = config.min_area * voxel_size**2 * intrinsics.fx * intrinsics.fy / max(depth, 1e-3) ** 2
    return int(np.ceil(max(1, area, config.min_pixels * intrinsics.width * intrinsics.height / (640 * 480))))
