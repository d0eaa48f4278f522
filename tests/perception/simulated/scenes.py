"""A frame with a floor and four things apart from each other, two of which touch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uppm.core.types import Frame, GroundTruth
from uppm.perception.fakes import fake_frame

FLOOR, SOFA, TV, RUG, CHAIR = 1, 2, 3, 4, 5
NAMES = {FLOOR: "floor", SOFA: "sofa", TV: "TV", RUG: "rug", CHAIR: "chair"}
THINGS = frozenset({SOFA, TV, RUG, CHAIR})
PLACES = {SOFA: (20, 90, 30, 130), TV: (20, 70, 200, 290), RUG: (130, 200, 40, 110), CHAIR: (150, 210, 110, 160)}
"""First and last row and column of each thing; the rug and the chair touch."""


def frame_of_things(index: int = 0) -> Frame:
    """320x240."""
    frame = fake_frame(index, height=240, width=320)
    instance = np.full((240, 320), FLOOR, dtype=np.int32)
    for number, (top, bottom, left, right) in PLACES.items():
        instance[top:bottom, left:right] = number
    return replace(frame, truth=GroundTruth(instance=instance, names=NAMES, things=THINGS))
