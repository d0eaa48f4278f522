"""Prompt files: what is asked of a map, and what is right (docs/evaluation.md)."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from uppm.core.categories import category_by_name
from uppm.core.errors import InputError
from uppm.evaluation.ground_truth import SurfaceTruth
from uppm.evaluation.sampling import SurfacePart

COLUMNS = ("prompt", "objects")


@dataclass(frozen=True, kw_only=True)
class Prompt:
    """One row of a prompt file."""

    text: str
    objects: tuple[str, ...]
    """Instance names or ids of the ground truth, or unified categories; none: it is not there."""


def read_prompts(file: Path) -> list[Prompt]:
    """Read lines `prompt<TAB>object|object` under that heading; raises `InputError` naming the file and line."""
    expected, advice = "lines prompt<TAB>objects under that heading", "see docs/evaluation.md"
    try:
        rows = list(csv.reader(file.read_text(encoding="utf-8").splitlines(), delimiter="\t"))
    except (OSError, UnicodeDecodeError) as error:
        found = "no such file" if isinstance(error, FileNotFoundError) else str(error)
        raise InputError(file, expected=expected, found=found, advice=advice) from None
    if not rows or tuple(rows[0]) != COLUMNS or len(rows) < 2:
        found = repr("\t".join(rows[0])) if rows and tuple(rows[0]) != COLUMNS else "no prompts"
        raise InputError(file, expected=expected, found=found, advice=advice)
    prompts = []
    for number, row in enumerate(rows[1:], start=2):
        if not row:
            continue
        if len(row) > 2 or not row[0].strip():
            found = repr("\t".join(row))
            raise InputError(f"{file}, line {number}", expected=expected, found=found, advice=advice)
        objects = tuple(name.strip() for name in (row[1] if len(row) == 2 else "").split("|") if name.strip())
        prompts.append(Prompt(text=row[0].strip(), objects=objects))
    return prompts


def meant_instances(prompts: Sequence[Prompt], truth: SurfaceTruth, owners: Mapping[int, int], source: str) -> Wanted:
    """For each prompt the submaps of each instance that it means, by name or id.

    Parameters
    ----------
    owners : submap -> the instance that it mainly is, or 0 (`instances.main_instances`).
    """
    submaps: dict[int, set[int]] = {}
    for submap, instance in owners.items():
        submaps.setdefault(instance, set()).add(submap)
    present = sorted(submaps.keys() | set(truth.instance.tolist()))
    names: dict[str, list[int]] = {}
    for number in present:
        if number in truth.instances:
            for name in (truth.instances[number].name, str(number)):
                names.setdefault(name, []).append(number)
    found = []
    for prompt in prompts:
        _check(prompt, names, source, "names or ids of instances with surface in the ground truth")
        numbers = dict.fromkeys(number for name in prompt.objects for number in names[name])
        found.append(tuple(frozenset(submaps.get(number, ())) for number in numbers))
    return found


def meant_categories(prompts: Sequence[Prompt], parts: Sequence[SurfacePart], source: str) -> Wanted:
    """For each prompt the submaps of its categories, together: without ground truth nobody knows how many there are."""
    found = []
    for prompt in prompts:
        _check(prompt, category_by_name(), source, "unified categories, or --ground-truth")
        submaps = frozenset(part.id for part in parts if part.category in prompt.objects)
        found.append((submaps,) if prompt.objects else ())
    return found


Wanted = list[tuple[frozenset[int], ...]]
"""For each prompt, for each object that is meant, its submaps."""


def _check(prompt: Prompt, known: Mapping[str, object], source: str, expected: str) -> None:
    for name in prompt.objects:
        if name not in known:
            where = f"{source}, prompt {prompt.text!r}"
            advice = "correct it, or leave the column empty if it is not there"
            raise InputError(where, expected=expected, found=repr(name), advice=advice)
