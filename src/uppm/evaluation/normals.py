"""Distance along the ground truth's normal: error of the surface itself, free of how far apart the points are."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from uppm.core.threads import usable_cores
from uppm.evaluation.geometry import NearestPoints, PointIndex, Points

NEIGHBOURS = 12
"""Points of the ground truth, itself included, through which a plane is laid: a patch of 3 to 4 cm where 1 cm apart."""
SAMPLES = 200_000
"""Points of R that are measured at most; their mean is known to 0.002 cm."""


def accuracy_along_normal(reconstruction: Points, truth: PointIndex, nearest: NearestPoints, seed: int = 0) -> float:
    """Mean of \\|(r - g) . n_g\\| over r in R with its nearest g in G, cm.

    The normal n_g of a point of G is the direction in which it and its nearest neighbours spread least. Of R (N, 3) a
    seeded choice of `SAMPLES` is measured where there are more.
    """
    chosen = np.arange(len(reconstruction))
    if len(chosen) > SAMPLES:
        chosen = np.random.default_rng(seed).choice(chosen, SAMPLES, replace=False)
    of, index = np.unique(nearest.truth[chosen], return_inverse=True)
    offset = reconstruction[chosen] - truth.points[nearest.truth[chosen]]
    return 100 * float(np.abs(np.einsum("ij,ij->i", offset, estimated_normals(truth, of)[index])).mean())


def estimated_normals(truth: PointIndex, of: npt.NDArray[np.intp]) -> Points:
    """Unit normals (K, 3), of either sign, at truth.points[of]."""
    points, count = truth.points, min(NEIGHBOURS, len(truth.points))
    near = truth.tree.query(points[of], k=count, workers=usable_cores())[1].reshape(len(of), -1)
    spread = points[near] - points[near].mean(axis=1, keepdims=True)
    return np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1][:, :, 0]
