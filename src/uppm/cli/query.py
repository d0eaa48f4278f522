"""`uppm query`: where something is."""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from uppm.map.answer import Reply
    from uppm.map.panoptic_map import QueryResult


def query(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    text: Annotated[str, typer.Argument(help="What to look for, in everyday words, or a question.")],
    limit: Annotated[int, typer.Option(min=1, help="At most so many answers.")] = 5,
    viewpoint: Annotated[
        str | None, typer.Option("--from", metavar="X,Y,Z", help="Where one looks from, metres, frame map.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Ask a map where something is, or a question; that nothing matches is an answer too."""
    from uppm.pipeline import open_map

    reply = open_map(path).ask(text, limit, None if viewpoint is None else _point(viewpoint))
    if as_json:
        typer.echo(json.dumps(reply.to_dict(), indent=2, ensure_ascii=False))
    elif reply.plain:
        if reply.note:
            typer.echo(f"{text!r}: {reply.note}")
        print_result(reply.plain)
    else:
        print_reply(reply)


def _point(text: str) -> list[float]:
    """Three numbers with commas between them."""
    from uppm.core.errors import InputError

    try:
        point = [float(value) for value in text.split(",")]
    except ValueError:
        point = []
    if len(point) != 3 or not all(map(isfinite, point)):
        advice = "write metres in frame map, as in --from 1.5,2,1.6"
        raise InputError("--from", expected="three numbers with commas between them", found=repr(text), advice=advice)
    return point


def print_reply(reply: Reply) -> None:
    """The answers to a question, how it was understood, and why each answers it."""
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from uppm.cli.info import numbers

    console = Console()
    console.print(escape(f"understood as: {reply.understood}"))
    if reply.counting:
        console.print(f"{reply.count}")
    if not reply.found:
        console.print(escape(f"{reply.text!r}: nothing here answers; {reply.note}"))
        return
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in ("id", "label", "because", "center, m", "size, m"):
        table.add_column(column, no_wrap=column not in ("label", "because"))
    for found in reply.results:
        place = (numbers(found.submap.center), numbers(found.submap.extent))
        table.add_row(*map(escape, (str(found.submap.id), found.label, "; ".join(found.reasons) or "-", *place)))
    console.print(table)
    if reply.count and reply.count > len(reply.results):
        console.print(f"{reply.count} in all; --limit shows more")


def print_result(result: QueryResult) -> None:
    """The answers as a table, or that there is none."""
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from uppm.cli.info import numbers

    console = Console()
    if not result.found:
        closest = (
            f"; closest: {result.closest[0].label} ({result.closest[0].probability:.0%})" if result.closest else ""
        )
        console.print(escape(f"{result.text!r}: nothing here matches{closest}"))
        return
    table = Table(title=escape(repr(result.text)), title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in ("id", "label", "category", "prob.", "center, m", "size, m"):
        table.add_column(column, no_wrap=column not in ("label", "category"))
    for answer in result.results:
        s = answer.submap
        category = s.descriptor.category.name if s.descriptor else "-"
        place = (numbers(s.center), numbers(s.extent))
        row = (str(s.id), answer.label, category, f"{answer.probability:.0%}", *place)
        table.add_row(*map(escape, row))
    console.print(table)
