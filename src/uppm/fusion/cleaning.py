"""Stray parts: pieces far from an object that a few leaking masks have left with it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

LEAST_SHARE = 0.1
"""Observations of a part, of those of the largest part, below which it is stray."""
TOUCHING = np.ones((3, 3, 3), dtype=np.bool_)


def stray_parts(
    points: npt.NDArray[np.float64], counts: npt.NDArray[np.float64], voxel_size: float
) -> npt.NDArray[np.bool_]:
    """Which surface voxels are of a stray part.

    Parts are what a gap of two voxels separates. A part with few observations, summed over its voxels, beside the
    largest part's was seen as the object's by mistake: a true part is seen whenever it is in view.

    Parameters
    ----------
    points : (N, 3)
        Voxel centres in frame submap, metres.
    counts : (N,)
        Times that each was seen as the submap's.
    voxel_size : float
        Metres.
    """
    voxels = np.floor(points / voxel_size).astype(np.intp)
    at = tuple((voxels - voxels.min(axis=0) + 1).T)
    grid = np.zeros(voxels.max(axis=0) - voxels.min(axis=0) + 3, dtype=np.bool_)
    grid[at] = True
    parts = np.empty(grid.shape, dtype=np.int32)
    ndimage.label(ndimage.binary_dilation(grid, TOUCHING), TOUCHING, output=parts)
    part = parts[at]
    seen = np.bincount(part, weights=counts)
    return seen[part] < LEAST_SHARE * seen.max()
