"""Which frames are looked at by the networks: by how far the camera moved, and how much of the view is new."""

from __future__ import annotations

import numpy as np

from uppm.core.config import PerceptionConfig
from uppm.core.geometry import backproject, invert, project, rotation_angle, transform
from uppm.core.types import Frame, Intrinsics

STRIDE = 8
"""Pixels between the points that are looked up in the last keyframe."""
MIN_DEPTH = 0.01
"""Metres before the last keyframe's camera; nearer points are beside its view."""
TOLERANCE = 0.05
"""Share of its depth by which a point may differ from what the last keyframe measured there."""


class KeyframePolicy:
    """Chooses keyframes by pose and depth alone, so that the choice does not wait for the map.

    Parameters
    ----------
    config : PerceptionConfig
        `keyframe` and the limits that go with it.
    """

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config
        self._last: Frame | None = None

    def restart(self) -> None:
        """The next frame is a keyframe."""
        self._last = None

    def choose(self, frame: Frame) -> bool:
        """Whether this frame, after those before it, is a keyframe."""
        if self._config.keyframe == "motion" and self._last is not None and not self._is_new(frame, self._last):
            return False
        self._last = frame
        return True

    def _is_new(self, frame: Frame, last: Frame) -> bool:
        c, T_last_frame = self._config, invert(last.T_map_camera) @ frame.T_map_camera
        angle = np.degrees(rotation_angle(T_last_frame))
        if np.linalg.norm(T_last_frame[:3, 3]) > c.keyframe_translation or angle > c.keyframe_rotation:
            return True
        return novelty(frame, last) > c.keyframe_novelty


def novelty(frame: Frame, last: Frame) -> float:
    """Share of a frame's measured points that an earlier frame did not measure: beside its view, or elsewhere."""
    depth = frame.depth[::STRIDE, ::STRIDE]
    measured = depth > 0
    points = backproject(depth, _every(STRIDE, frame.intrinsics))[measured]
    if not len(points):
        return 0.0
    points = transform(invert(last.T_map_camera) @ frame.T_map_camera, points)
    points = points[points[:, 2] > MIN_DEPTH]
    column, row = np.rint(project(points, last.intrinsics)).astype(int).T
    seen = (column >= 0) & (row >= 0) & (column < last.intrinsics.width) & (row < last.intrinsics.height)
    expected = points[seen, 2]
    agree = np.abs(last.depth[row[seen], column[seen]] - expected) <= TOLERANCE * expected
    return 1 - float(agree.sum() / measured.sum())


def _every(stride: int, k: Intrinsics) -> Intrinsics:
    """The camera of every stride-th pixel both ways, the first included."""
    height, width = -(-k.height // stride), -(-k.width // stride)
    fx, fy, cx, cy = k.fx / stride, k.fy / stride, k.cx / stride, k.cy / stride
    return Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, width=width, height=height)
