"""The tree of frames that /tf and /tf_static tell, asked for a transform at a time."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation, Slerp

from uppm.core.geometry import invert, pose_from_quaternion

Pose = npt.NDArray[np.float64]


class NoTransformError(Exception):
    """What is missing for a transform, in words."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """A rigid motion sampled over time, interpolated between samples.

    Parameters
    ----------
    times : (N,)
        Seconds, ascending.
    poses : (N, 4, 4)
    """

    times: npt.NDArray[np.float64]
    poses: npt.NDArray[np.float64]

    def at(self, time: float, tolerance: float) -> Pose:
        """The pose (4, 4) at a time: between its neighbours, or the end's at most `tolerance` seconds beyond it."""
        times = self.times
        if not times[0] - tolerance <= time <= times[-1] + tolerance:
            side, end = ("before the first", times[0]) if time < times[0] else ("after the last", times[-1])
            raise NoTransformError(f"{abs(time - end):.3f} s {side} of {len(times)}")
        after = int(np.searchsorted(times, time))
        if after == len(times) or times[after] == time or after == 0:
            return self.poses[min(after, len(times) - 1)]
        pair = slice(after - 1, after + 1)
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        pose = np.eye(4)
        pose[:3, :3] = Slerp(times[pair], Rotation.from_matrix(self.poses[pair, :3, :3]))(time).as_matrix()
        pose[:3, 3] = (1 - share) * self.poses[after - 1, :3, 3] + share * self.poses[after, :3, 3]
        return pose


def track(samples: list[tuple[float, Pose]]) -> Track:
    """A track of samples in any order; of two at one time the later one given counts."""
    by_time = dict(samples)
    times = np.array(sorted(by_time))
    return Track(times=times, poses=np.stack([by_time[time] for time in times]))


class TransformTree:
    """Frames, each with one parent: fixed on it, or moving (REP 105)."""

    def __init__(self) -> None:
        self._fixed: dict[str, tuple[str, Pose]] = {}
        self._samples: defaultdict[str, list[tuple[float, Pose]]] = defaultdict(list)
        self._parent: dict[str, str] = {}
        self._tracks: dict[str, Track] = {}

    def add(self, parent: str, child: str, time: float, T_parent_child: Pose, *, fixed: bool) -> None:
        """One transform as a message tells it; the last parent told counts."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if fixed:
            self._fixed[child] = (parent, T_parent_child)
            return
        if self._parent.get(child, parent) != parent:
            self._samples[child].clear()
        self._parent[child] = parent
        self._samples[child].append((time, T_parent_child))
        self._tracks.pop(child, None)

    def forget(self, child: str, *, before: float) -> None:
        """Drop a moving frame's samples of before a time, but for the last: what runs for days must not grow."""
        samples = self._samples[child.lstrip("/")]
        kept = [sample for sample in samples if sample[0] >= before] or samples[-1:]
        if len(kept) < len(samples):
            self._samples[child.lstrip("/")] = kept
            self._tracks.pop(child.lstrip("/"), None)

    @property
    def frames(self) -> list[str]:
        """Names of all frames, sorted."""
        edges = [(child, parent) for child, (parent, _) in self._fixed.items()] + list(self._parent.items())
        return sorted({name for edge in edges for name in edge})

    def ancestors(self, frame: str) -> list[str]:
        """The frame, its parent, and so on to the root."""
        chain = [frame]
        while (above := self._above(chain[-1])) and above not in chain:
            chain.append(above)
        return chain

    def moves(self, frame: str, ancestor: str) -> bool:
        """Whether a moving transform lies between the two."""
        chain = self.ancestors(frame)
        return any(child in self._parent for child in chain[: chain.index(ancestor)])

    def lookup(self, target: str, source: str, time: float, tolerance: float) -> Pose:
        """T_target_source (4, 4) at a time in seconds; raises `NoTransformError`, which says what is missing."""
        up, down = self.ancestors(source), self.ancestors(target)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            raise NoTransformError(f"no path between {target!r} and {source!r}")
        return invert(self._to(common, target, time, tolerance)) @ self._to(common, source, time, tolerance)

    def _to(self, ancestor: str, frame: str, time: float, tolerance: float) -> Pose:
        """T_ancestor_frame."""
        pose = np.eye(4)
        for child in self.ancestors(frame):
            if child == ancestor:
                break
            pose = self._edge(child, time, tolerance) @ pose
        return pose

    def _edge(self, child: str, time: float, tolerance: float) -> Pose:
        if child not in self._parent:
            return self._fixed[child][1]
        if child not in self._tracks:
            self._tracks[child] = track(self._samples[child])
        try:
            return self._tracks[child].at(time, tolerance)
        except NoTransformError as error:
            raise NoTransformError(f"{self._parent[child]!r} to {child!r}: {error}") from None

    def _above(self, frame: str) -> str | None:
        if frame in self._parent:
            return self._parent[frame]
        return self._fixed[frame][0] if frame in self._fixed else None


def pose_of(transform: object) -> Pose:
    """(4, 4) of a geometry_msgs Transform or Pose."""
    place = transform.translation if hasattr(transform, "translation") else transform.position  # pyright: ignore
    turn = transform.rotation if hasattr(transform, "rotation") else transform.orientation  # pyright: ignore
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    if not 0.9 < np.linalg.norm(quaternion) < 1.1:
        return np.full((4, 4), np.nan)
    return pose_from_quaternion([place.x, place.y, place.z], quaternion)
