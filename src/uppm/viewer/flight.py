"""Where the served page's camera starts, and how it flies to an object."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.geometry import level_axes
from uppm.core.shown import Shown

Vector = npt.NDArray[np.float64]

STEPS, SECONDS = 16, 0.5
STEEPNESS = 0.75
"""Of the view, in radians over the horizon."""


def start_view(shown: Sequence[Shown], up: Vector) -> tuple[Vector, Vector]:
    """Eye and target (3,) from which a whole map is seen, frame map."""
    corners = np.concatenate([s.submap.bounds for s in shown if np.isfinite(s.submap.bounds).all()] or [np.eye(3)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    target = (low + high) / 2
    first, _ = level_axes(up)
    distance = float(0.62 * np.linalg.norm(high - low))
    return target + distance * (np.cos(0.95) * first + np.sin(0.95) * up), target


def near_view(shown: Shown, eye: Vector, up: Vector) -> tuple[Vector, Vector]:
    """Eye and target from which an object is seen, from the side on which the eye is now."""
    target = shown.submap.center
    level = (eye - target) - up * ((eye - target) @ up)
    size = np.linalg.norm(level)
    level = level / size if size > 1e-6 else level_axes(up)[0]
    distance = max(1.2, 2.4 * float(np.linalg.norm(shown.submap.extent)))
    return target + distance * (np.cos(STEEPNESS) * level + np.sin(STEEPNESS) * up), target


def fly(client: Any, eye: Vector, target: Vector) -> None:
    """Move a browser's camera there, smoothly; the time it takes is this thread's."""
    camera = client.camera
    if camera.update_timestamp == 0.0:
        return  # that browser has not said yet where it is
    from_eye, from_target = camera.position.copy(), camera.look_at.copy()
    for step in range(1, STEPS + 1):
        t = step / STEPS
        eased = t * t * (3 - 2 * t)
        with client.atomic():
            camera.position = from_eye + eased * (eye - from_eye)
            camera.look_at = from_target + eased * (target - from_target)
        client.flush()
        time.sleep(SECONDS / STEPS)
