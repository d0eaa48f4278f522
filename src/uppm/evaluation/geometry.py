"""Geometric metrics between a reconstructed surface R and the ground truth G (paper section 4, method.md section 7).

R is everything reconstructed: no part of it is left out because the ground truth lacks it. G is what the cameras
saw within range. A map of the same frames and range has a right to surface only there, so whatever else it holds is
an error; maps made with another range are to be cut to it before they are compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from uppm.core.errors import InputError
from uppm.core.threads import usable_cores

THRESHOLD = 0.05
"""Metres: the 5 cm of the completion ratio, precision, recall and F1."""
CELL = 0.1
"""Metres: queries are asked cell by cell."""

NEAR = 0.1
"""Metres: queries with no point so near are asked again of the second tree."""
LEAF, FAR_LEAF = 16, 128
"""Points in a leaf of the trees for near and for far queries."""

Points = npt.NDArray[np.float64]


class PointIndex:
    """Answers which of some points (M, 3) is the nearest; its trees are built when first asked for, and kept."""

    def __init__(self, points: Points) -> None:
        self.points = points

    @cached_property
    def tree(self) -> KDTree:
        """For queries near the points."""
        return KDTree(self.points, leafsize=LEAF, balanced_tree=False)

    @cached_property
    def far_tree(self) -> KDTree:
        """For queries metres away: the nearest could be in hundreds of small leaves, so that larger ones are faster."""
        return KDTree(self.points, leafsize=FAR_LEAF, balanced_tree=False)

    def nearest(self, queries: Points) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
        """Distance and index (N,) of the nearest point for each query (N, 3)."""
        # Neighbours asked for one after the other find the tree's nodes in the cache: three times as fast.
        order, threads = np.lexsort(np.floor(queries / CELL).T), usable_cores()
        distance, index = np.empty(len(queries)), np.empty(len(queries), dtype=np.intp)
        distance[order], index[order] = self.tree.query(queries[order], distance_upper_bound=NEAR, workers=threads)
        far = order[np.isinf(distance[order])]
        if len(far):
            distance[far], index[far] = self.far_tree.query(queries[far], workers=threads)
        return distance, index


@dataclass(frozen=True, kw_only=True, eq=False)
class NearestPoints:
    """For N points of R and M of G, the nearest point of the other set."""

    to_truth: npt.NDArray[np.float64]
    """(N,) distance, metres."""
    truth: npt.NDArray[np.intp]
    """(N,) index into G."""
    to_reconstruction: npt.NDArray[np.float64]
    """(M,) distance, metres."""
    reconstruction: npt.NDArray[np.intp]
    """(M,) index into R."""


@dataclass(frozen=True, kw_only=True)
class GeometricMetrics:
    """Distances in cm, shares from 0 to 1; `docs/evaluation.md` defines each."""

    accuracy_cm: float
    completeness_cm: float
    chamfer_l1_cm: float
    """Sum of accuracy and completeness."""
    chamfer_l1_half_cm: float
    """Their mean, as other papers print it."""
    chamfer_squared_cm2: float
    """Sum of the two mean squares: the paper's equation, each of its sums a mean."""
    chamfer_cm: float
    """Its square root, a length."""
    hausdorff_cm: float
    hausdorff_95_cm: float
    """The larger of the two 95th percentiles."""
    completion_ratio_5cm: float
    precision_5cm: float
    recall_5cm: float
    f1_5cm: float
    f1_foreground_5cm: float | None
    """F1 without floors, walls and ceilings; None where there is nothing else."""


def nearest_points(reconstruction: Points, truth: PointIndex) -> NearestPoints:
    """Nearest neighbours both ways between R (N, 3) and G (M, 3), metres; raises `InputError` where one is empty."""
    for name, points in (("reconstruction", reconstruction), ("ground truth", truth.points)):
        if not len(points):
            raise InputError(name, expected="points on a surface", found="none", advice="check what it was made from")
    to_truth, i = truth.nearest(reconstruction)
    to_reconstruction, j = PointIndex(reconstruction).nearest(truth.points)
    return NearestPoints(to_truth=to_truth, truth=i, to_reconstruction=to_reconstruction, reconstruction=j)


def geometric_metrics(nearest: NearestPoints, foreground: npt.NDArray[np.bool_] | None = None) -> GeometricMetrics:
    """All geometric metrics of one comparison.

    Parameters
    ----------
    foreground : (M,) bool, the points of G that are on no floor, wall or ceiling; None: nothing is known of that.
        A point of R counts as foreground where its nearest point of G is.
    """
    r, g = nearest.to_truth, nearest.to_reconstruction
    accuracy, completeness = 100 * float(r.mean()), 100 * float(g.mean())
    squared = 100**2 * float(np.mean(r**2) + np.mean(g**2))
    precision, recall = share_within(r), share_within(g)
    return GeometricMetrics(
        accuracy_cm=accuracy,
        completeness_cm=completeness,
        chamfer_l1_cm=accuracy + completeness,
        chamfer_l1_half_cm=(accuracy + completeness) / 2,
        chamfer_squared_cm2=squared,
        chamfer_cm=float(np.sqrt(squared)),
        hausdorff_cm=100 * float(max(r.max(), g.max())),
        hausdorff_95_cm=100 * float(max(np.percentile(r, 95), np.percentile(g, 95))),
        completion_ratio_5cm=recall,
        precision_5cm=precision,
        recall_5cm=recall,
        f1_5cm=f1(precision, recall),
        f1_foreground_5cm=None if foreground is None else _foreground_f1(nearest, foreground),
    )


def share_within(distances: npt.NDArray[np.float64], threshold: float = THRESHOLD) -> float:
    """Share of distances, metres, that are at most the threshold."""
    return float(np.mean(distances <= threshold))


def f1(precision: float, recall: float) -> float:
    """Harmonic mean; 0 where both are."""
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _foreground_f1(nearest: NearestPoints, foreground: npt.NDArray[np.bool_]) -> float | None:
    if not foreground.any():
        return None
    claimed = nearest.to_truth[foreground[nearest.truth]]
    precision = share_within(claimed) if len(claimed) else 0.0
    return f1(precision, share_within(nearest.to_reconstruction[foreground]))
