"""What each object of the development data may be called, and what it may be taken for; written by hand."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources

from uppm.perception.labels.lemma import lemmatize


@dataclass(frozen=True, kw_only=True)
class Names:
    """One row of `simulated_names.csv`."""

    names: tuple[str, ...]
    """What it is rightly called; the first is its name in `labels.csv`."""
    near: tuple[str, ...]
    """What it may be taken for, of other categories than its own."""


@cache
def name_table() -> Mapping[str, Names]:
    """Name in `labels.csv` -> its row."""
    table = resources.files("uppm.data").joinpath("simulated_names.csv").read_text(encoding="utf-8")
    return {
        row["name"]: Names(names=tuple(row["names"].split("|")), near=tuple(row["near"].split("|")))
        for row in csv.DictReader(table.splitlines())
    }


def names_of(name: str) -> Names:
    """The row of a name; a name that is not in the table has no other names and is never taken for anything else."""
    return name_table().get(name) or Names(names=(name,), near=())


@cache
def normal_names(name: str) -> tuple[str, ...]:
    """The right names of an object as labels are written: lemmatised."""
    return tuple(dict.fromkeys(map(lemmatize, names_of(name).names)))


def all_labels() -> list[str]:
    """Every name and everything that something is taken for, lemmatised."""
    return [lemmatize(text) for row in name_table().values() for text in (*row.names, *row.near)]
