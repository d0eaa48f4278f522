"""What geometry says against a detection: a chair is not three metres long, and the floor is no part of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from uppm.core.categories import SIZE_PRIORS, category_by_name
from uppm.core.types import Frame, Segment

Mask = npt.NDArray[np.bool_]

MAX_EXTENT = {SIZE_PRIORS["small"]: 0.8, SIZE_PRIORS["medium"]: 2.2, SIZE_PRIORS["large"]: 6.0}
"""Size prior -> largest extent of a thing with it, metres."""
KEEP_OFF_FLOOR = 0.3
"""A mask that keeps less than this share off the floor is a thing lying flat on it, and stays whole."""


def has_plausible_size(frame: Frame, mask: Mask, label: str) -> bool:
    """Whether the extent of the mask (H, W) along the image's axes and the depth is one of such a thing."""
    category = category_by_name().get(label)
    rows, columns = np.nonzero(mask[::4, ::4] & (frame.depth[::4, ::4] > 0))
    if category is None or not len(rows):
        return True
    k, z = frame.intrinsics, frame.depth[4 * rows, 4 * columns]
    points = np.stack([(4 * columns - k.cx) / k.fx * z, (4 * rows - k.cy) / k.fy * z, z])
    low, high = np.quantile(points, (0.03, 0.97), axis=1)
    return float((high - low).max()) < MAX_EXTENT[category.voxel_size]


def off_the_floor(mask: Mask, structure: list[tuple[Mask, Segment]]) -> Mask:
    """The mask without the floor and the ceiling that it leaked to."""
    rest = mask.copy()
    for surface, segment in structure:
        if segment.label.text in ("floor", "ceiling"):
            rest &= ~surface
    return rest if np.count_nonzero(rest) >= KEEP_OFF_FLOOR * np.count_nonzero(mask) else mask
