"""What a few leaking masks have left with an object: stray parts, far from it, and rims, which others were seen at."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

LEAST_SHARE = 0.1
"""Observations of a part, of those of the largest part, below which it is stray."""

SELDOM, MOST = 0.67, 0.9
"""Share of the times that a submap's most often seen voxels were, at this quantile, below which one is seldom seen."""


def stray_parts(
    points: npt.NDArray[np.float64], counts: npt.NDArray[np.float64], voxel_size: float
) -> npt.NDArray[np.bool_]:
    """Which surface voxels are of a stray part.

    Parts are what a gap of two to four voxels separates (neighbouring cells of 2x2x2 voxels are connected). A part with
    few observations, summed over its voxels, beside the largest part's was seen as the object's by mistake: a true part
    is seen whenever it is in view.

    Parameters
    ----------
    points : (N, 3)
        Voxel centres in frame submap, metres.
    counts : (N,)
        Times that each was seen as the submap's.
    voxel_size : float
        Metres.
    """
    cells, cell = np.unique(np.floor(points / (2 * voxel_size)).astype(np.int64), axis=0, return_inverse=True)
    pairs = KDTree(cells).query_pairs(1.5, p=np.inf, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), dtype=np.bool_), (pairs[:, 0], pairs[:, 1])), shape=(len(cells),) * 2)
    part = connected_components(graph, directed=False)[1][cell.ravel()]
    seen = np.bincount(part, weights=counts)
    return seen[part] < LEAST_SHARE * seen.max()


def seldom_seen(counts: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Which surface voxels (N,) few of a submap's masks covered, beside those that most of them did.

    counts (N,): times that each was seen as the submap's. An object that is seldom found is covered alike all
    over; the rim that a mask leaks onto is another one in each frame.
    """
    if not len(counts):
        return np.zeros(0, dtype=np.bool_)
    return counts < SELDOM * np.quantile(counts, MOST)
