"""Checks shared by the frozen types: each returns its argument or raises `InputError` with the value in the text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError


def check_array(name: str, array: object, *, dtype: npt.DTypeLike, shape: Sequence[int | None]) -> None:
    """Raise unless `array` is an ndarray of the dtype and shape; None in `shape` stands for any length."""
    wanted = f"{np.dtype(dtype)} array of shape ({', '.join('any' if n is None else str(n) for n in shape)})"
    if not isinstance(array, np.ndarray):
        raise InputError(name, expected=wanted, found=type(array).__name__, advice="convert it with np.asarray")
    found = cast("npt.NDArray[np.generic]", array)
    fits = found.ndim == len(shape) and all(n is None or n == m for n, m in zip(shape, found.shape, strict=True))
    if not fits or found.dtype != np.dtype(dtype):
        raise InputError(name, expected=wanted, found=f"{found.dtype} {found.shape}", advice="convert or reshape it")


def check_pose(name: str, pose: npt.NDArray[np.float64]) -> None:
    """Raise unless `pose` is a finite rigid transform (4, 4): rotation orthonormal within 1e-2, last row 0 0 0 1."""
    check_array(name, pose, dtype=np.float64, shape=(4, 4))
    if not np.isfinite(pose).all():
        raise InputError(name, expected="a finite 4x4 pose", found="NaN or infinity", advice="skip this frame")
    R = pose[:3, :3]
    error = float(np.abs(R @ R.T - np.eye(3)).max())
    if error > 1e-2 or np.linalg.det(R) < 0 or not np.allclose(pose[3], (0, 0, 0, 1), atol=1e-6):
        found = f"rotation off orthonormal by {error:.3g}, determinant {np.linalg.det(R):.3g}, last row {pose[3]}"
        raise InputError(name, expected="a rigid 4x4 pose", found=found, advice="check the pose file's layout")


def check_range(name: str, value: float, low: float, high: float) -> None:
    """Raise unless low <= value <= high."""
    if not low <= value <= high:
        raise InputError(name, expected=f"{low} to {high}", found=f"{value}", advice="correct the value")
