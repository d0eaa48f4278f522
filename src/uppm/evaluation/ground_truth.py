"""Ground truth: the surface that the cameras saw, and the instances on it. One reader a format in `truth/`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.evaluation.geometry import PointIndex

UNKNOWN = 0
"""Instance of points of which nothing is known but that they are surface."""


@dataclass(frozen=True, kw_only=True)
class TruthInstance:
    """One instance, or one stretch of background."""

    id: int
    name: str
    is_thing: bool
    """A countable object; the others are floors, walls and ceilings."""
    categories: tuple[str, ...]
    """Unified categories that are right for it; the first is the class that it is counted under."""
    pixels: int | None
    """Pixels of all frames that show it; None where nobody counted: it then counts as seen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceTruth:
    """G of the metrics: M points, each of one instance."""

    source: str
    points: npt.NDArray[np.float64]
    """(M, 3), metres, frame map."""
    instance: npt.NDArray[np.int32]
    """(M,): key of `instances`, or 0: unknown."""
    instances: Mapping[int, TruthInstance]
    is_observed: bool = True
    """Only what the cameras saw within range is in it; otherwise it is a whole scan (`observed.observe`)."""
    unmapped: tuple[str, ...] = ()
    """Labels without a unified category, whose instances are unknown."""

    @cached_property
    def index(self) -> PointIndex:
        """Of `points`; built once, however many reconstructions are compared with them."""
        return PointIndex(self.points)

    @property
    def foreground(self) -> npt.NDArray[np.bool_]:
        """(M,): the point is of a thing, hence on no floor, wall or ceiling."""
        things = [i.id for i in self.instances.values() if i.is_thing]
        return np.isin(self.instance, things)

    @property
    def classes_without_points(self) -> frozenset[str]:
        """Classes of the instances none of which has a point in G: nothing can be said of them."""
        present = set(np.unique(self.instance).tolist())
        seen = {i.categories[0] for i in self.instances.values() if i.id in present}
        return frozenset(i.categories[0] for i in self.instances.values()) - seen


class TruthReader(Protocol):
    """What a module of `truth/` offers."""

    LOOKS_FOR: str
    """For messages."""

    @staticmethod
    def matches(path: Path) -> bool:
        """Whether the folder has this format's marks; reads no file."""
        ...

    @staticmethod
    def read(path: Path) -> SurfaceTruth:
        """Its surface and instances; raises `InputError` naming the file at fault."""
        ...

    @staticmethod
    def instances(path: Path) -> Mapping[int, TruthInstance]:
        """The instances alone, by the ids of the frames' instance images."""
        ...


READERS = ("frames", "scannet", "three_rscan", "panmap_flat", "replica")
"""Modules of `uppm.evaluation.truth`, asked in this order."""


def load_surface_truth(path: Path) -> SurfaceTruth:
    """Read the ground truth of a sequence or scan; raises `InputError` naming the file at fault."""
    return _reader(path).read(path)


def load_instances(path: Path) -> Mapping[int, TruthInstance]:
    """Read the instances alone, as the frames' instance images number them."""
    return _reader(path).instances(path)


def _reader(path: Path) -> TruthReader:
    if not path.is_dir():
        found = "a file" if path.exists() else "no such folder"
        advice = "give a sequence or scan with ground truth (docs/evaluation.md)"
        raise InputError(path, expected="a folder", found=found, advice=advice)
    readers = [import_module(f"uppm.evaluation.truth.{name}") for name in READERS]
    for reader in readers:
        if reader.matches(path):
            return reader  # pyright: ignore[reportReturnType]
    # The layout to convert to says best what it misses.
    if (path / "color").is_dir() or (path / "labels.csv").exists():
        return readers[0]  # pyright: ignore[reportReturnType]
    formats = "; ".join(reader.LOOKS_FOR for reader in readers)
    advice = "only a sequence with ground truth can be compared with (docs/evaluation.md)"
    raise InputError(path, expected=f"ground truth: {formats}", found="none of these", advice=advice)
