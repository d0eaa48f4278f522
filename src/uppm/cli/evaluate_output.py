"""What every regime of `uppm evaluate` does with its results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Iterable

    from uppm.core.config import Config
    from uppm.regimes.report import Report


def show(report: Report, output: Path | None, *, as_json: bool) -> None:
    """Print a table, or JSON; with `output` also write the report's files there."""
    from uppm.regimes.report import to_json, write_report

    written = write_report(output, report) if output else []
    if as_json:
        found = to_json(report)["results"]
        typer.echo(json.dumps(found if len(found) > 1 else found[0], indent=2))
        return
    _print_table(report)
    for file in written:
        typer.echo(str(file))


def _print_table(report: Report) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from uppm.evaluation.html import shown
    from uppm.regimes.report import rows

    table = Table(title=escape(report.title), title_justify="left")
    table.add_column("", no_wrap=True)
    for method in report.results:
        table.add_column(escape(method), overflow="fold")
    for row in rows(report.results):
        table.add_row(*(escape(shown(cell)) for cell in row))
    console = Console()
    console.print(table)
    for method, result in report.results.items():
        for note in result.get("notes", ()):
            console.print(f"{escape(method)}: {escape(note)}", style="yellow")
    console.print("definitions: docs/evaluation.md")


def unique_names(paths: Iterable[Path]) -> list[str]:
    """The files' names without folder and ending; a number is added where two are alike."""
    names: list[str] = []
    for path in paths:
        stem, count = path.stem, 2
        name = stem
        while name in names:
            name, count = f"{stem}_{count}", count + 1
        names.append(name)
    return names


def front_ends(names: str, config: str | None, overrides: list[str]) -> dict[str, Config]:
    """Front end -> the configuration that differs in it alone; raises `ConfigError` for an unknown name."""
    from uppm.core.config import Config
    from uppm.core.errors import InputError
    from uppm.perception.registry import create_segmenter

    chosen = [name.strip() for name in names.split(",") if name.strip()]
    if not chosen:
        expected = "front ends such as groundtruth,embedded"
        raise InputError("--perception", expected=expected, found=repr(names), advice="name one")
    found = {name: Config.load(config, [*overrides, f"perception.profile={name}"]) for name in chosen}
    for settings in found.values():
        # An unknown name is told before the first of them has run for minutes.
        create_segmenter(settings.perception)
    return found
