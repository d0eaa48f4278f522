"""What a viewer shows of a map: the values between the map and the viewers; frozen, as `core.types`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from uppm.core.types import Mesh, Submap, SubmapKind

Coloring = Literal["texture", "instance", "category", "confidence", "change"]
COLORINGS: tuple[Coloring, ...] = get_args(Coloring)
Color = tuple[int, int, int]

UNKNOWN_COLOR: Color = (150, 152, 158)
"""Of what has no confidence, or was compared with no older map."""
CHANGE_COLORS: Mapping[str, Color] = MappingProxyType(
    {
        "persistent": (120, 150, 190),
        "new": (40, 175, 90),
        "moved": (240, 160, 30),
        "absent": (215, 60, 60),
        "unobserved": UNKNOWN_COLOR,
    }
)
CONFIDENCE_COLORS: tuple[Color, Color, Color] = ((68, 1, 84), (33, 145, 140), (253, 231, 37))
"""Of confidence 0, 1/2 and 1: dark to light, so that they differ to every eye."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """One submap as it is shown."""

    submap: Submap
    mesh: Mesh
    """Frame map."""
    name: str
    """Its commonest label; of background the category."""
    facts: Mapping[str, Any]
    """What there is to tell of it, for JSON: lengths in metres, frame map."""
    colors: Mapping[str, Color]
    """Its one colour in each colouring but `texture`."""

    @property
    def is_object(self) -> bool:
        """A thing, not background."""
        return self.submap.kind is SubmapKind.OBJECT


@dataclass(frozen=True, kw_only=True)
class Answers:
    """What a map answers to a prompt."""

    ids: tuple[int, ...]
    """Submaps, the best first; none: nothing answers."""
    said: tuple[str, ...]
    """How the prompt was understood, why nothing answers, and a line for each answer."""


def no_answers(text: str) -> Answers:
    """Of a map that cannot be asked."""
    return Answers(ids=(), said=("this map cannot be asked",))


@dataclass(frozen=True, kw_only=True, eq=False)
class Content:
    """Everything of a map that is shown."""

    title: str
    up: npt.NDArray[np.float64]
    """(3,) unit vector against gravity, frame map."""
    shown: tuple[Shown, ...]
    """The submaps that are believed and have a surface, by id."""
    free: npt.NDArray[np.float32]
    """(N, 3) centres of freespace's voxels that were seen to be free, metres, frame map."""
    path: tuple[tuple[int, npt.NDArray[np.float64]], ...]
    """Index and T_map_camera (4, 4) of each frame that was integrated, in order."""
    gone: tuple[Mapping[str, Any], ...] = ()
    """Of an older map's objects those that this one lacks, for JSON."""
    ask: Callable[[str], Answers] = no_answers
    """Answers a prompt; raises `UppmError` where it has no words or the encoder cannot be found."""
