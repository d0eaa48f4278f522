"""What each unified category is called and how it is explained: by hand, and by WordNet."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources

from uppm.core.categories import category_by_name, plain_name
from uppm.core.types import Category
from uppm.perception.labels.lemma import lemmatize


@dataclass(frozen=True, kw_only=True)
class Prototypes:
    """One category's row."""

    category: Category
    gloss: str
    terms: tuple[str, ...]
    """Everyday words for it and for kinds of it, by hand; no term stands for two categories."""
    wordnet_terms: tuple[str, ...]
    """Further names that WordNet has for its synsets."""
    wordnet_glosses: tuple[str, ...]
    """WordNet's explanations of its synsets."""


@cache
def prototypes() -> tuple[Prototypes, ...]:
    """All rows, in the order of the category table."""
    return tuple(
        Prototypes(
            category=category_by_name()[row["name"]],
            gloss=row["gloss"],
            terms=_split(row["terms"]),
            wordnet_terms=_split(found["terms"]),
            wordnet_glosses=_split(found["glosses"]),
        )
        for row, found in zip(_rows("prototypes.csv"), _rows("wordnet_prototypes.csv"), strict=True)
    )


def _rows(name: str) -> Iterator[dict[str, str]]:
    table = resources.files("uppm.data").joinpath(name).read_text(encoding="utf-8")
    return iter(csv.DictReader(table.splitlines()))


def _split(cell: str) -> tuple[str, ...]:
    return tuple(cell.split("|")) if cell else ()


@cache
def lexicon() -> dict[str, int]:
    """Lemmatised name or term, by hand -> row of the category table."""
    found: dict[str, int] = {}
    for number, row in enumerate(_rows("prototypes.csv")):
        for text in (row["name"], plain_name(row["name"]), *_split(row["terms"])):
            found.setdefault(lemmatize(text), number)
    return found
