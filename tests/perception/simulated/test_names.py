"""The table of names: every object of the development data has a row, whose names mean what it is."""

from __future__ import annotations

import csv
from importlib import resources
from pathlib import Path

from tests.conftest import SHARED
from uppm.perception.retrieval.category import PrototypeRetriever
from uppm.perception.simulated.names import name_table, names_of, normal_names

DEMO = Path(str(resources.files("uppm.data"))) / "demo" / "labels.csv"


def accepted() -> dict[str, set[str]]:
    """Name -> categories that are right for it, of the demo and, where it is there, of the rendered flat."""
    found: dict[str, set[str]] = {}
    for file in (DEMO, *(SHARED / "data" / "flat" / run / "labels.csv" for run in ("run1", "run2"))):
        if file.exists():
            for row in csv.DictReader(file.read_text(encoding="utf-8").splitlines()):
                found.setdefault(row["name"], set()).update(row["categories"].split("|"))
    return found


def test_every_object_has_names_of_which_the_first_is_its_own() -> None:
    assert set(accepted()) <= set(name_table())
    for name, row in name_table().items():
        assert row.names[0] == name
        assert len(set(row.names)) == len(row.names) >= 3
        assert row.near
        assert not set(row.names) & set(row.near)


def test_names_have_a_right_category_and_what_it_is_taken_for_a_wrong_one() -> None:
    retriever = PrototypeRetriever()
    for name, categories in accepted().items():
        row = name_table()[name]
        right, wrong = ([c.name for c in retriever.retrieve(texts)] for texts in (row.names, row.near))
        assert set(right) <= categories, name
        assert not set(wrong) & categories, name


def test_what_is_not_in_the_table_is_called_by_its_name() -> None:
    assert names_of("zither").names == ("zither",)
    assert names_of("zither").near == ()
    assert normal_names("tulips")[:2] == ("tulip", "bouquet of tulips")
