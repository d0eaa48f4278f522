"""Fusing analytic scenes: the shapes of `tests.scenes` from a ring of cameras, into one fusion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tests.scenes import described, look_at, render
from uppm.core.categories import unified_categories
from uppm.core.config import Config, FusionConfig
from uppm.core.types import Submap
from uppm.fusion.engine import PanopticFusion
from uppm.map.mesh import submap_mesh

RING = [[1.7 * np.cos(a), 1.7 * np.sin(a), 1.1] for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)]
TARGET = [0.0, 0.0, 0.3]


def similarity(**pairs: float) -> npt.NDArray[np.float32]:
    """Cosines of categories: 1 with itself, 0 with others, but for those given as `table__dining_table=0.8`."""
    row = {category.name.replace(" ", "_"): n for n, category in enumerate(unified_categories())}
    matrix = np.eye(len(row), dtype=np.float32)
    for pair, value in pairs.items():
        a, b = (row[name] for name in pair.split("__"))
        matrix[a, b] = matrix[b, a] = value
    return matrix


def settings(preset: str = "uppm", **changes: object) -> FusionConfig:
    """A preset's settings of the fusion with changes, and a small pool."""
    fusion = Config.load(preset).fusion.model_dump()
    return FusionConfig.model_validate({**fusion, "max_blocks": 20000, **changes})


def new_fusion(config: FusionConfig | None = None, **pairs: float) -> PanopticFusion:
    return PanopticFusion(config or settings(), similarity(**pairs))


def see(
    fusion: PanopticFusion,
    shapes: Sequence,
    names: list[tuple[str, str]],
    frame: int,
    *,
    eye: Sequence[float] | None = None,
    segments: Sequence[int] | None = None,
    score: float = 1.0,
) -> npt.NDArray[np.int32]:
    """Fuse one frame; returns the submap id of each pixel.

    segments: id of the segment that each shape belongs to, 0 for none; names: label and category of each segment.
    """
    seen, ids = render(list(shapes), look_at(eye if eye is not None else RING[frame % len(RING)], TARGET), frame)
    if segments is not None:
        ids = np.array([0, *segments], dtype=np.int32)[ids]
    return fusion.fuse(seen, described(ids, names, score=score))


def fuse(shapes, names, eyes=RING, config=None, matrix=None) -> PanopticFusion:
    fusion = PanopticFusion(config or settings(), similarity() if matrix is None else matrix)
    for n, eye in enumerate(eyes):
        see(fusion, shapes, names, n, eye=eye)
    return fusion


def objects(fusion: PanopticFusion) -> list[Submap]:
    """Submaps that something was said of."""
    return [s for s in fusion.submaps() if s.descriptor is not None]


def vertices(fusion: PanopticFusion, submap: Submap) -> npt.NDArray[np.float32]:
    return submap_mesh(submap, fusion.blocks(submap.id)).vertices
