"""The curated table of what each unified category is called: names, synonyms, kinds of it, and a gloss."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib import resources

from uppm.core.categories import category_by_name
from uppm.core.types import Category


@dataclass(frozen=True, kw_only=True)
class Prototypes:
    """One category's row."""

    category: Category
    gloss: str
    terms: tuple[str, ...]
    """Everyday words for it and for kinds of it; no term stands for two categories."""


@cache
def prototypes() -> tuple[Prototypes, ...]:
    """All rows, in the order of the category table."""
    table = resources.files("uppm.data").joinpath("prototypes.csv").read_text(encoding="utf-8")
    return tuple(
        Prototypes(category=category_by_name()[row["name"]], gloss=row["gloss"], terms=tuple(row["terms"].split("|")))
        for row in csv.DictReader(table.splitlines())
    )
