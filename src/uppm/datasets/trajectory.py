"""Trajectories as text: a time, a translation and a quaternion a line (TUM's layout, evo's too)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.datasets import files


def rows(path: Path) -> list[list[str]]:
    """Words of each line that says something; # begins a comment."""
    lines = (line.strip() for line in files.read_text(path).splitlines())
    return [line.replace(",", " ").split() for line in lines if line and not line.startswith("#")]


def read_trajectory(path: Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Times (N,) in seconds, and poses (N, 7) of translation and quaternion, in the file's order.

    Raises
    ------
    InputError
        The file has other lines than `time tx ty tz qx qy qz qw`, or none.
    """
    found = rows(path)
    values = files.parse_numbers(" ".join(" ".join(row) for row in found))
    if not found or values is None or any(len(row) != 8 for row in found):
        what, advice = "other lines" if found else "no line", "see docs/datasets.md"
        raise InputError(path, expected="lines of time tx ty tz qx qy qz qw", found=what, advice=advice)
    table = values.reshape(-1, 8)
    return table[:, 0], table[:, 1:]
