"""`uppm edit`: correct a map by hand."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from uppm.editing import Edit
    from uppm.map.corrections import Action, Correction


def edit(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    merge: Annotated[list[str] | None, typer.Option(metavar="KEPT=OTHER", help="Make a submap part of one.")] = None,
    rename: Annotated[list[str] | None, typer.Option(metavar="ID=NAME", help="Say what it is.")] = None,
    category: Annotated[list[str] | None, typer.Option(metavar="ID=CATEGORY", help="Pin its category.")] = None,
    delete: Annotated[list[int] | None, typer.Option(metavar="ID", help="Leave it out.")] = None,
    undo: Annotated[bool, typer.Option("--undo", help="Undo the latest edit.")] = False,
    by: Annotated[str | None, typer.Option(help="Who corrects; the name of the user if not given.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Correct a map by hand: merge, rename, pin a category, delete, in this order; no options: what was corrected."""
    from dataclasses import asdict

    from uppm.core.errors import InputError
    from uppm.editing import Edit, edit_map, undo_edit
    from uppm.map.store import MapReader

    edits = [*_pairs("merge", merge), *_pairs("rename", rename), *_pairs("category", category)]
    edits += [Edit(action="delete", submap=submap) for submap in delete or ()]
    if undo and edits:
        raise InputError("--undo", expected="no other edit beside it", found="one", advice="give two commands")
    if undo:
        made = undo_edit(path, _author(by))
    elif edits:
        made = edit_map(path, edits, _author(by))
    else:
        made = MapReader.open(path).corrections()
    if as_json:
        typer.echo(json.dumps([asdict(correction) for correction in made], indent=2, ensure_ascii=False))
    else:
        _print(made, "undone: " if undo else "")


def _pairs(action: Action, values: Iterable[str] | None) -> Iterator[Edit]:
    from uppm.core.errors import InputError
    from uppm.editing import Edit

    for text in values or ():
        number, equals, value = text.partition("=")
        if not equals or not number.strip().isdecimal():
            advice = "write the submap's id first; `uppm info` lists the ids"
            raise InputError(f"--{action}", expected="ID=VALUE", found=repr(text), advice=advice)
        yield Edit(action=action, submap=int(number), value=value.strip())


def _author(given: str | None) -> str:
    from getpass import getuser

    if given is not None:
        return given
    try:
        return getuser()
    except (KeyError, OSError):  # A container's user may have no name.
        return "unknown"


def _print(made: Iterable[Correction], before: str) -> None:
    found = list(made)
    for c in found:
        undone = f"; undone {c.undone}" if c.undone else ""
        typer.echo(f"{before}{c.edit}. {_sentence(c)} ({c.stamp} by {c.author}{undone})")
    if not found:
        typer.echo("nothing was corrected by hand")


def _sentence(c: Correction) -> str:
    was = f"{c.before.get('label')} ({c.before.get('category')})"
    if c.action == "merge":
        other = c.before.get("other", {}).get("label")
        return f"submap {c.submap}, {was}: took in submap {c.other}, {other}"
    if c.action == "delete":
        return f"submap {c.submap}, {was}: deleted"
    now = f"called {c.name} ({c.category})" if c.action == "rename" else f"category {c.category}"
    return f"submap {c.submap}, {was}: {now}"
