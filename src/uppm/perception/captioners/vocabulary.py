"""The same words for every picture: what a detector that reads any words is to look for, without a network."""

from __future__ import annotations

from uppm.core.categories import unified_categories
from uppm.core.config import PerceptionConfig
from uppm.core.language import Caption
from uppm.core.types import Frame
from uppm.perception.captioners.tag_list import read_descriptions

THINGS = (
    "accessory",
    "kitchen",
    "food",
    "furniture",
    "electronic",
    "appliance",
    "indoor",
    "textile",
    "furniture-stuff",
)
SURFACES = ("floor", "ceiling", "wall", "window")
"""Supercategories whose kinds (of brick, of tiles) are one word."""


class Vocabulary:
    """Captioner whose tags are those of `tag_list`, or what the unified categories have indoors."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._said = Caption(tags=tuple(read_descriptions(config.tag_list)) if config.tag_list else indoors())

    def caption(self, frame: Frame) -> Caption:
        """The tags."""
        return self._said


def indoors() -> tuple[str, ...]:
    """Names of unified categories that stand in rooms, as one would say them: `door`, not `door-stuff`."""
    names = (c.name.removesuffix("-stuff") for c in unified_categories() if c.supercategory in THINGS)
    return tuple(dict.fromkeys((*(name for name in names if not name.endswith("-other")), *SURFACES)))
