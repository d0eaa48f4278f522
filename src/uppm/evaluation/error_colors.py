"""Colours of errors: how far from the truth, and whose surface a submap took."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

import numpy as np
import numpy.typing as npt

from uppm.evaluation.geometry import THRESHOLD
from uppm.evaluation.ground_truth import TruthInstance

Colors = npt.NDArray[np.uint8]

_RAMP = np.array([[38, 84, 162], [82, 170, 198], [238, 230, 150], [236, 138, 68], [178, 24, 43]], dtype=np.float64)
MISSED = (200, 30, 45)
FOUND = (196, 200, 206)


class InstanceError(Enum):
    """What is right or wrong with a place of a reconstruction; each with its colour."""

    RIGHT = (92, 172, 108)
    MISNAMED = (238, 172, 62)
    FOREIGN = (206, 52, 60)
    UNLABELED = (196, 200, 206)
    NO_TRUTH = (142, 112, 180)

    @property
    def meaning(self) -> str:
        """In words, for a legend."""
        return _MEANINGS[self]


_MEANINGS = {
    InstanceError.RIGHT: "the submap's own instance, under a right category",
    InstanceError.MISNAMED: "the submap's own instance, under a wrong category",
    InstanceError.FOREIGN: "another instance than the one that the submap mainly is",
    InstanceError.UNLABELED: "background without a label",
    InstanceError.NO_TRUTH: "no labeled ground truth within 5 cm",
}


def distance_colors(distances: npt.NDArray[np.floating], limit: float = THRESHOLD) -> Colors:
    """(N, 3) RGB of distances (N,), metres: blue at 0 over yellow to red at the limit and beyond."""
    position = np.clip(distances / limit, 0, 1) * (len(_RAMP) - 1)
    channels = [np.interp(position, np.arange(len(_RAMP)), channel) for channel in _RAMP.T]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def instance_colors(
    categories: Mapping[int, str | None],
    part: npt.NDArray[np.integer],
    instance: npt.NDArray[np.integer],
    owners: Mapping[int, int],
    instances: Mapping[int, TruthInstance],
) -> npt.NDArray[np.uint8]:
    """(N, 3) RGB: the colour of what is right or wrong with each of N points or pixels.

    Parameters
    ----------
    categories : part (submap or segment) id -> its category, None without one.
    part : (N,) id of the part that each point is of.
    instance : (N,) true instance of each, 0 where none is near.
    owners : part id -> the instance that it mainly is, or 0 (`instances.main_instances`).
    instances : the true ones.
    """
    pairs, inverse = np.unique(np.stack([part, instance]), axis=1, return_inverse=True)
    colors = [
        _error(categories[int(p)], owners.get(int(p), 0), instances.get(int(i)), instances).value for p, i in pairs.T
    ]
    return np.array(colors, dtype=np.uint8).reshape(-1, 3)[inverse.ravel()]


def _error(
    category: str | None, owner: int, instance: TruthInstance | None, instances: Mapping[int, TruthInstance]
) -> InstanceError:
    if category is None:
        return InstanceError.UNLABELED
    if instance is None:
        return InstanceError.NO_TRUTH
    # Stuff is one segment a class, so a floor in two rooms is no other's.
    if not (owner <= 0 or owner == instance.id or _one_stuff(instances[owner], instance)):
        return InstanceError.FOREIGN
    return InstanceError.RIGHT if category in instance.categories else InstanceError.MISNAMED


def _one_stuff(a: TruthInstance, b: TruthInstance) -> bool:
    return not a.is_thing and not b.is_thing and a.categories[0] == b.categories[0]
