"""Prompt files, and what a prompt means in a map."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.evaluation.scenes import grid, square, write_truth
from uppm.core.errors import InputError
from uppm.evaluation.ground_truth import load_surface_truth
from uppm.evaluation.prompts import Prompt, meant_categories, meant_instances, read_prompts
from uppm.evaluation.sampling import SurfacePart


def write(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "prompts.tsv"
    file.write_text(text, encoding="utf-8")
    return file


def test_file(tmp_path: Path) -> None:
    found = read_prompts(write(tmp_path, "prompt\tobjects\nsettee\tsofa|7\n\nbicycle\t\nzebra\n"))
    assert found == [
        Prompt(text="settee", objects=("sofa", "7")),
        Prompt(text="bicycle", objects=()),
        Prompt(text="zebra", objects=()),
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "found no prompts"),
        ("prompt\tobjects\n", "found no prompts"),
        ("question,answer\nx,y\n", "found 'question,answer'"),
        ("prompt\tobjects\na\tb\tc\n", "line 2: .*found 'a\\\\tb\\\\tc'"),
        ("prompt\tobjects\n \tb\n", "line 2"),
    ],
)
def test_bad_files(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_prompts(write(tmp_path, text))
    with pytest.raises(InputError, match="no such file"):
        read_prompts(tmp_path / "none.tsv")


def test_instances_by_name_and_id(tmp_path: Path) -> None:
    truth = load_surface_truth(write_truth(tmp_path, {1: grid(0, 0, 0), 2: grid(0, 0, 1), 3: grid(0, 0, 2)}))
    prompts = [
        Prompt(text="cup", objects=("mug",)),
        Prompt(text="seat", objects=("3",)),
        Prompt(text="both", objects=("mug", "sofa", "3")),
        Prompt(text="bicycle", objects=()),
    ]
    owners = {11: 2, 12: 2, 13: 1, 14: 0, 15: -1}
    # The sofa is in the ground truth and not in the map.
    assert meant_instances(prompts, truth, owners, "p.tsv") == [
        (frozenset({11, 12}),),
        (frozenset(),),
        (frozenset({11, 12}), frozenset()),
        (),
    ]
    # The coin is in labels.csv, but no camera saw it.
    with pytest.raises(InputError, match=r"p\.tsv, prompt 'money': expected names or ids .* found 'coin'"):
        meant_instances([Prompt(text="money", objects=("coin",))], truth, owners, "p.tsv")


def test_categories_without_ground_truth() -> None:
    parts = [
        SurfacePart(id=4, mesh=square(0, 0, 0), category="couch"),
        SurfacePart(id=5, mesh=square(0, 0, 0), category="chair"),
        SurfacePart(id=6, mesh=square(0, 0, 0)),
    ]
    prompts = [Prompt(text="seat", objects=("couch", "chair")), Prompt(text="cup", objects=("cup",))]
    assert meant_categories([*prompts, Prompt(text="zebra", objects=())], parts, "p.tsv") == [
        (frozenset({4, 5}),),
        (frozenset(),),
        (),
    ]
    with pytest.raises(InputError, match="expected unified categories"):
        meant_categories([Prompt(text="x", objects=("settee",))], parts, "p.tsv")
