"""How well depths predicted into a neighbouring frame agree with those measured there, under a hypothesis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.errors import BadFrameError
from uppm.core.geometry import invert, rotation_angle, transform
from uppm.core.types import Frame, Intrinsics
from uppm.datasets.hypotheses import Hypothesis, scaled
from uppm.datasets.poses import pose_matrix

Pose = npt.NDArray[np.float64]

POINTS = 3000
"""Pixels sampled of a frame."""
MIN_INSIDE, MIN_MEASURED = 0.25, 0.1
"""Least share of the sampled points that must fall into the other image, and onto a measured pixel of it."""
BASELINE, ANGLE = 0.15, np.deg2rad(10)
"""Motion after which a frame is another's partner: enough to tell hypotheses apart, with most of the view shared."""
MAX_GAP = 12
"""Frames between partners at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """What of a frame the comparison needs."""

    raw_pose: Pose
    """As in the file."""
    pixels: npt.NDArray[np.int64]
    """(N, 2): u, v of sampled pixels with depth."""
    depth: npt.NDArray[np.float32]
    """(H, W), metres."""
    median_depth: float
    """Metres."""
    where: str
    index: int


@dataclass(frozen=True)
class Agreement:
    """Medians over pairs of the pair's median; infinite where most pairs do not overlap at all."""

    cm: float
    share: float
    """Of the depth: comparable between depth scales."""


def view(frame: Frame, raw_pose: Pose, where: str) -> View:
    """A frame reduced to a regular sample of its valid pixels."""
    v, u = np.nonzero(frame.depth > 0)
    step = max(1, len(u) // POINTS)
    pixels = np.stack([u, v], axis=-1)[step // 2 :: step]
    median = float(np.median(frame.depth[pixels[:, 1], pixels[:, 0]]))
    return View(
        raw_pose=raw_pose, pixels=pixels, depth=frame.depth, median_depth=median, where=where, index=frame.index
    )


def partners(poses: Mapping[int, Pose], count: int) -> list[tuple[int, int]]:
    """About `count` pairs of frames, spread over the sequence, with some motion between the two."""
    order = sorted(poses)
    if len(order) < 2:
        return []
    anchors = np.unique(np.linspace(0, len(order) - 2, count).round().astype(int))
    return [(order[a], _partner(poses, order[a : a + MAX_GAP + 1])) for a in anchors]


def _partner(poses: Mapping[int, Pose], following: Sequence[int]) -> int:
    T_a_map = invert(poses[following[0]])
    for index in following[1:]:
        T_a_b = T_a_map @ poses[index]
        if np.linalg.norm(T_a_b[:3, 3]) > BASELINE or rotation_angle(T_a_b) > ANGLE:
            return index
    return following[-1]


def agreement(pairs: Sequence[tuple[View, View]], intrinsics: Intrinsics, hypothesis: Hypothesis) -> Agreement:
    """Agreement of all pairs under a hypothesis."""
    each = [pair_agreement(a, b, intrinsics, hypothesis) for a, b in pairs]
    return Agreement(float(np.median([e.cm for e in each])), float(np.median([e.share for e in each])))


def pair_agreement(
    a: View, b: View, intrinsics: Intrinsics, hypothesis: Hypothesis, quantile: float = 0.5
) -> Agreement:
    """Median (or another quantile of) |predicted - measured| depth over the pixels of b on which points of a fall.

    Points that b sees hidden behind something differ too; in partners they are few, and the median passes over them.
    Two views that share less than `MIN_INSIDE` of the points do not agree at all: a wrong pose looks elsewhere.
    """
    none = Agreement(np.inf, np.inf)
    try:
        T_map_a, T_map_b = (pose_matrix(each.raw_pose, each.where, hypothesis.config) for each in (a, b))
    except BadFrameError:
        return none
    K = scaled(intrinsics, hypothesis.intrinsics_factor)
    u, v = a.pixels.T
    z = a.depth[v, u] * hypothesis.depth_factor
    points = transform(invert(T_map_b) @ T_map_a, np.stack([(u - K.cx) / K.fx * z, (v - K.cy) / K.fy * z, z], axis=-1))
    points = points[points[:, 2] > 1e-6]
    ub = np.rint(K.fx * points[:, 0] / points[:, 2] + K.cx)
    vb = np.rint(K.fy * points[:, 1] / points[:, 2] + K.cy)
    inside = (ub >= 0) & (ub < K.width) & (vb >= 0) & (vb < K.height)
    measured = b.depth[vb[inside].astype(int), ub[inside].astype(int)] * hypothesis.depth_factor
    seen = measured > 0
    if inside.sum() < max(MIN_INSIDE * len(u), 1) or seen.sum() < max(MIN_MEASURED * len(u), 1):
        return none
    difference = np.abs(points[inside, 2][seen] - measured[seen])
    shares = difference / measured[seen]
    return Agreement(100 * float(np.quantile(difference, quantile)), float(np.quantile(shares, quantile)))
