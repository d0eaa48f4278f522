"""From a data set's labels to unified categories: tables in `uppm.data.class_maps`, curated by hand."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib import resources

from uppm.core.categories import category_by_name, plain_name


@dataclass(frozen=True, kw_only=True)
class LabelClass:
    """What a label means."""

    is_thing: bool
    """Countable in the data set's annotation."""
    categories: tuple[str, ...]
    """Right unified categories, the first the one that it is counted under."""


@cache
def class_map(name: str) -> dict[str, LabelClass]:
    """The table of a data set: label in lower case -> its meaning."""
    text = resources.files("uppm.data.class_maps").joinpath(f"{name}.csv").read_text(encoding="utf-8")
    return {
        row["label"]: LabelClass(is_thing=row["thing"] == "1", categories=tuple(row["categories"].split("|")))
        for row in csv.DictReader(text.splitlines())
    }


def classify(label: str, *tables: str, coarse: str = "") -> LabelClass | None:
    """The meaning of a label; None where it has no unified category.

    Parameters
    ----------
    label : as the data set writes it.
    tables : names of class maps, the first that has the label decides; then a category of that very name.
    coarse : the data set's own coarse class (NYU40), asked of the table `nyu40` at last.
    """
    text = label.strip().lower()
    for table in tables:
        if text in class_map(table):
            return class_map(table)[text]
    for name in (text, _by_plain_name().get(text, "")):
        if name in category_by_name():
            return LabelClass(is_thing=category_by_name()[name].is_thing, categories=(name,))
    return class_map("nyu40").get(coarse.strip().lower())


@cache
def _by_plain_name() -> dict[str, str]:
    return {plain_name(name): name for name in category_by_name()}
