"""Is a reconstruction the ground truth's scene in another frame? Found by ICP from several starts (trimesh's)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from uppm.core.geometry import rotation_angle, transform

SAMPLES = 3000
"""Points of R that are matched."""
TRUTH_SAMPLES = 200_000
"""Points of G at most that they are matched with."""
REACH = 0.25
"""Metres; larger distances count as this, since what is missing is far from everything."""
MIN_SHIFT = 0.01
"""Metres that the points must move, root mean square, for the frames to count as different."""
MIN_GAIN = 0.2
"""Share of the mean distance that the motion must take away."""
LOST = 0.05
"""Metres of mean distance from which on other starts than the frames as they are get tried."""
_ITERATIONS, _TRIAL_ITERATIONS = 100, 8

Points = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """A rigid motion that brings a reconstruction onto the ground truth."""

    T_truth_map: npt.NDArray[np.float64]
    """(4, 4), rigid."""
    before_cm: float
    """Mean distance of R to G, distances over 25 cm counted as such."""
    after_cm: float
    shift_cm: float
    """How far the points of R move, root mean square."""

    @property
    def rotation_deg(self) -> float:
        """Angle of the rotation."""
        return float(np.rad2deg(rotation_angle(self.T_truth_map)))


def find_misalignment(reconstruction: Points, truth: Points, seed: int = 0) -> Alignment | None:
    """The motion between the frames of R (N, 3) and G (M, 3), metres; None where there is none worth speaking of."""
    random = np.random.default_rng(seed)
    points = _some(reconstruction, SAMPLES, random)
    tree = KDTree(_some(truth, TRUTH_SAMPLES, random))
    before = _mean_distance(points, tree)
    T = _icp(points, tree, np.eye(4), _ITERATIONS)
    if _mean_distance(transform(T, points), tree) > LOST:
        trials = [_icp(points, tree, start, _TRIAL_ITERATIONS) for start in _starts(points, np.asarray(tree.data))]
        best = min(trials, key=lambda trial: _mean_distance(transform(trial, points), tree))
        T = min((T, _icp(points, tree, best, _ITERATIONS)), key=lambda t: _mean_distance(transform(t, points), tree))
    after = _mean_distance(transform(T, points), tree)
    shift = float(np.sqrt(((transform(T, points) - points) ** 2).sum(axis=1).mean()))
    if shift < MIN_SHIFT or after > (1 - MIN_GAIN) * before:
        return None
    return Alignment(T_truth_map=T, before_cm=100 * before, after_cm=100 * after, shift_cm=100 * shift)


def _icp(points: Points, tree: KDTree, start: npt.NDArray[np.float64], iterations: int) -> npt.NDArray[np.float64]:
    from trimesh.registration import icp

    T, _, _ = icp(points, tree.data, start, 1e-9, iterations, scale=False, reflection=False)
    return np.asarray(T)


def _starts(points: Points, truth: Points) -> Iterator[npt.NDArray[np.float64]]:
    """The 24 rotations of a cube, each with the boxes' centres on each other."""
    centre, to = (p.min(axis=0) / 2 + p.max(axis=0) / 2 for p in (points, truth))
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        R = np.eye(3)[list(order)] * np.array(signs)[:, None]
        if np.linalg.det(R) > 0:
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = R, to - R @ centre
            yield T


def _mean_distance(points: Points, tree: KDTree) -> float:
    return float(np.minimum(tree.query(points, workers=2)[0], REACH).mean())


def _some(points: Points, count: int, random: np.random.Generator) -> Points:
    return points if len(points) <= count else points[random.choice(len(points), count, replace=False)]
