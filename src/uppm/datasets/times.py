"""What belongs together by its time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def nearest(times: npt.NDArray[np.float64], others: npt.NDArray[np.float64], tolerance: float) -> npt.NDArray[np.intp]:
    """Index (N,) of the other time (M,) nearest to each time (N,), seconds; -1 where it is farther than `tolerance`."""
    order = np.argsort(others, kind="stable")
    place = np.searchsorted(others[order], times).clip(1, max(len(others) - 1, 1))
    before, after = order[place - 1], order[np.minimum(place, len(others) - 1)]
    found = np.where(np.abs(others[before] - times) <= np.abs(others[after] - times), before, after)
    return np.where(np.abs(others[found] - times) <= tolerance, found, -1)
