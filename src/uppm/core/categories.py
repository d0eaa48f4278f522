"""The unified categories: COCO-Stuff's 171 classes with hand-curated size priors (method.md section 2)."""

from __future__ import annotations

import csv
import hashlib
from functools import cache
from importlib import resources

from uppm.core.types import Category, LabelRecord

SIZE_PRIORS = {"small": 0.02, "medium": 0.03, "large": 0.05}
"""Voxel sizes in metres (paper section 3.2.2)."""


@cache
def unified_categories() -> tuple[Category, ...]:
    """All categories, in the order of the table."""
    table = resources.files("uppm.data").joinpath("coco_stuff.csv").read_text(encoding="utf-8")
    return tuple(
        Category(
            id=int(row["id"]),
            name=row["name"],
            supercategory=row["supercategory"],
            is_thing=row["kind"] == "thing",
            voxel_size=SIZE_PRIORS[row["size"]],
        )
        for row in csv.DictReader(table.splitlines())
    )


@cache
def category_by_name() -> dict[str, Category]:
    """Name -> category."""
    return {category.name: category for category in unified_categories()}


@cache
def category_by_id() -> dict[int, Category]:
    """Id -> category."""
    return {category.id: category for category in unified_categories()}


FIRST_LABEL_ID = 1 << 32
"""Ids of the table's categories are below."""


@cache
def label_category(text: str) -> Category:
    """A category of a label's own, for mapping without unified semantics; its id is a hash of the text."""
    number = int.from_bytes(hashlib.blake2b(text.encode(), digest_size=6).digest(), "big")
    return Category(
        id=FIRST_LABEL_ID + number,
        name=text,
        supercategory="label",
        is_thing=True,
        voxel_size=SIZE_PRIORS["medium"],
    )


def category_of(record: LabelRecord) -> Category:
    """The category that a label was retrieved to."""
    return label_category(record.text) if record.category >= FIRST_LABEL_ID else category_by_id()[record.category]


def plain_name(category: str) -> str:
    """A category's name as one says it: 'window-other' -> 'window', 'floor-wood' -> 'floor wood'."""
    return category.removesuffix("-other").removesuffix("-stuff").replace("-", " ")
