"""Colours for instances and categories: far apart for things, pale for what stands around them."""

from __future__ import annotations

import colorsys

from uppm.core.types import Submap, SubmapKind

_GOLDEN = 0.61803398875
_TONES = ((0.62, 0.93), (0.80, 0.78), (0.45, 0.98), (0.70, 0.62))
"""Saturation and value, in turn: neighbours in the hue circle differ in tone too."""
_PALE = 0.72


def distinct(index: int) -> tuple[int, int, int]:
    """RGB of the index-th colour; successive ones lie a golden section of the hue circle apart."""
    saturation, value = _TONES[index % len(_TONES)]
    r, g, b = colorsys.hsv_to_rgb((0.08 + index * _GOLDEN) % 1.0, saturation, value)
    return round(255 * r), round(255 * g), round(255 * b)


def submap_color(submap: Submap, coloring: str) -> tuple[int, int, int]:
    """RGB of a submap by `instance` or `category`; background is pale, so that the things stand out."""
    category = submap.descriptor.category.id if submap.descriptor else 0
    r, g, b = distinct(category if coloring == "category" else submap.id)
    if submap.kind is SubmapKind.OBJECT:
        return r, g, b
    return _pale(r), _pale(g), _pale(b)


def _pale(channel: int) -> int:
    return round(channel + _PALE * (225 - channel))
