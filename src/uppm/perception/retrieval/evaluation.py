"""How often retrieval is right on a list of labels with the categories that a person would accept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uppm.core.categories import category_by_name
from uppm.core.errors import InputError
from uppm.core.protocols import Retriever


@dataclass(frozen=True, kw_only=True)
class Miss:
    """A label whose category no person would accept."""

    label: str
    found: str
    accepted: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class RetrievalResult:
    """Share of right labels, and the others."""

    accuracy: float
    """0 to 1."""
    labels: int
    misses: tuple[Miss, ...]


def read_labels(file: Path) -> list[tuple[str, tuple[str, ...]]]:
    """Labels with accepted category names, from lines `label<TAB>name|name` under one heading.

    Raises
    ------
    InputError
        The file cannot be read, holds no labels, or names a category that is not in the table.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()[1:]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(file, expected="a text file", found=str(error), advice="give a list of labels") from None
    rows = [line for line in lines if line.strip()]
    if not rows:
        advice = "write one label a line under a heading: label<TAB>category|category"
        raise InputError(file, expected="labels", found="none", advice=advice)
    return [_read_row(file, row) for row in rows]


def _read_row(file: Path, row: str) -> tuple[str, tuple[str, ...]]:
    label, tab, accepted = row.partition("\t")
    names = tuple(name.strip() for name in accepted.split("|"))
    unknown = [name for name in names if name not in category_by_name()]
    if not tab or unknown:
        advice = "write label<TAB>category|category with names from the COCO-Stuff table"
        found = f"{unknown[0]!r} for {label!r}" if tab else repr(row)
        raise InputError(file, expected="accepted category names", found=found, advice=advice)
    return label.strip(), names


def evaluate_retrieval(labels: Sequence[tuple[str, tuple[str, ...]]], retriever: Retriever) -> RetrievalResult:
    """Accuracy of a retriever: a label is right if its category is among the accepted ones."""
    found = retriever.retrieve([text for text, _ in labels])
    misses = tuple(
        Miss(label=text, found=category.name, accepted=accepted)
        for (text, accepted), category in zip(labels, found, strict=True)
        if category.name not in accepted
    )
    return RetrievalResult(accuracy=1 - len(misses) / len(labels), labels=len(labels), misses=misses)


def by_supercategory(
    labels: Sequence[tuple[str, tuple[str, ...]]], result: RetrievalResult
) -> dict[str, tuple[int, int]]:
    """How many labels of each supercategory, that of the first accepted category, are right and wrong."""
    missed = Counter(category_by_name()[miss.accepted[0]].supercategory for miss in result.misses)
    total = Counter(category_by_name()[accepted[0]].supercategory for _, accepted in labels)
    return {name: (total[name] - missed[name], missed[name]) for name in sorted(total)}
