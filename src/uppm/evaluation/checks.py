"""Is a reconstruction comparable with the ground truth at all? Asked before anything is measured."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError

UNIT_FACTORS = (1000.0, 100.0, 0.001)
UNIT_TOLERANCE = 3.0
"""The sizes of map and ground truth may differ so much beside the factor."""


def check_comparable(
    reconstruction: npt.NDArray[np.floating], truth: npt.NDArray[np.floating], source: str, truth_source: str
) -> None:
    """Raise `InputError` where vertices (N, 3) cannot be of the scene (M, 3): not finite, other units, elsewhere."""
    if not len(reconstruction):
        advice = "map a sequence into it first"
        raise InputError(source, expected="a reconstructed surface", found="none", advice=advice)
    if not np.isfinite(reconstruction).all():
        raise InputError(source, expected="finite vertices", found="NaN or infinity", advice="export the mesh again")
    low, high = reconstruction.min(axis=0), reconstruction.max(axis=0)
    truth_low, truth_high = truth.min(axis=0), truth.max(axis=0)
    size, truth_size = float(np.linalg.norm(high - low)), float(np.linalg.norm(truth_high - truth_low))
    expected = f"the scene of {truth_source}, {truth_size:.4g} m across"
    for factor in UNIT_FACTORS:
        if 1 / UNIT_TOLERANCE < size / (truth_size * factor) < UNIT_TOLERANCE:
            found = f"one {size:.4g} across, {factor:g} times that"
            raise InputError(source, expected=expected, found=found, advice="its units are not metres: scale it")
    if (low > truth_high).any() or (high < truth_low).any():
        found = f"one from {_corner(low)} to {_corner(high)}, outside {_corner(truth_low)} to {_corner(truth_high)}"
        advice = "align the two frames, or name the map's own sequence"
        raise InputError(source, expected=expected, found=found, advice=advice)


def _corner(point: npt.NDArray[np.floating]) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in point) + ")"
