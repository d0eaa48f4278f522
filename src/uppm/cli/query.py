"""`uppm query`: where something is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from uppm.map.panoptic_map import QueryResult


def query(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    text: Annotated[str, typer.Argument(help="What to look for, in everyday words.")],
    limit: Annotated[int, typer.Option(min=1, help="At most so many answers.")] = 5,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Ask a map where something is; that nothing matches is an answer too."""
    from uppm.pipeline import open_map

    result = open_map(path).query(text, limit)
    if as_json:
        typer.echo(json.dumps(result.to_dict(), indent=2, ensure_ascii=False))
    else:
        print_result(result)


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
