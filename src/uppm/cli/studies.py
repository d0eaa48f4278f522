"""`uppm evaluate ablation` and `uppm evaluate noise`: a sequence mapped with one setting after another."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

SequenceFolder = Annotated[Path, typer.Argument(help="Sequence in the `frames` layout, with ground truth.")]
Settings = Annotated[
    list[str] | None, typer.Option("--set", help="One setting for all, as perception.simulated.seed=1.")
]
Folder = Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.", metavar="DIR")]
Resume = Annotated[bool, typer.Option("--resume", help="Keep the runs that the folder has; measure the others.")]


def evaluate_ablation_command(
    sequence: SequenceFolder,
    output: Folder,
    perception: Annotated[str, typer.Option(help="Front end of every variant.")] = "simulated",
    config: Annotated[Path | None, typer.Option(help="YAML file of settings for all.")] = None,
    set_: Settings = None,
    resume: Resume = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """The paper's ablations on one sequence: its tables, ours beside its own figures (docs/simulated.md)."""
    from uppm.export.files import write_json
    from uppm.regimes.report import make_folder, write_report
    from uppm.studies.ablation import fill, run_ablation
    from uppm.studies.mapping import SharedPerception
    from uppm.studies.measure import measure
    from uppm.studies.paper_tables import TABLES
    from uppm.studies.report import ablation_report
    from uppm.studies.runs import Runs

    def tell(name: str, done: int, total: int) -> None:
        typer.echo(f"{done + 1} of {total}: {name}", err=True)

    make_folder(output)
    settings = [f"perception.profile={json.dumps(perception)}", *(set_ or [])]
    runs = Runs.open(output / "ablation-runs.json", partial(measure, shared=SharedPerception()), resume=resume)
    figures = run_ablation(sequence, config, settings, runs, tell)
    tables = [{"title": table.title, "paper_data": table.paper_data, "rows": fill(table, figures)} for table in TABLES]
    found = {"data": sequence.name, "perception": perception, "settings": set_ or [], "tables": tables}
    write_json(output / "ablation.json", found)
    rows = [table["rows"] for table in tables]
    written = write_report(output, ablation_report(sequence.name, perception, rows, figures, output))
    if as_json:
        typer.echo(json.dumps(found, indent=2))
    else:
        _print_tables(sequence.name, perception, tables)
        typer.echo("\n".join(map(str, written)))


def evaluate_noise_command(
    sequences: Annotated[list[Path], typer.Argument(help="Sequences with ground truth.")],
    output: Folder,
    levels: Annotated[str, typer.Option(help="Noise levels, separated by commas.")] = "0,0.5,1,1.5,2",
    set_: Settings = None,
    resume: Resume = False,
) -> None:
    """Curves of PQ, object count and recall against simulated noise, for UPPM, PPM and panmap (docs/simulated.md)."""
    from uppm.regimes.report import make_folder, write_report
    from uppm.studies.mapping import SharedPerception
    from uppm.studies.measure import measure
    from uppm.studies.noise import draw_curves, noise_curves
    from uppm.studies.report import noise_report
    from uppm.studies.runs import Runs

    def tell(method: str, level: float, sequence: str) -> None:
        typer.echo(f"{sequence}: {method} at noise {level:g}", err=True)

    make_folder(output)
    runs = Runs.open(output / "noise-runs.json", partial(measure, shared=SharedPerception()), resume=resume)
    rows = noise_curves(sequences, read_levels(levels), set_ or [], runs, tell)
    draw_curves(rows).savefig(output / "noise.png", dpi=120)
    _print_curves(rows)
    typer.echo("\n".join(map(str, [*write_report(output, noise_report(rows, output)), output / "noise.png"])))


def read_levels(text: str) -> list[float]:
    """Numbers of 0 or more, separated by commas."""
    from uppm.core.errors import InputError

    try:
        levels = [float(part) for part in text.split(",")]
    except ValueError:
        levels = []
    if not levels or not all(0 <= level < 100 for level in levels):
        advice = "write them as 0,0.5,1"
        raise InputError("--levels", expected="numbers from 0 on, separated by commas", found=repr(text), advice=advice)
    return levels


def _print_tables(data: str, perception: str, filled: Sequence[Mapping[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table

    from uppm.studies.ablation import cell
    from uppm.studies.paper_tables import TABLES

    console = Console(width=120)
    for table, part in zip(TABLES, filled, strict=True):
        paper = bool(table.paper_data)
        shown = Table("", *(f"{c.title}\nours{' / paper' if paper else ''}" for c in table.columns), title=table.title)
        for row in part["rows"]:
            shown.add_row(row["row"], *(cell(row, c, paper=paper) for c in table.columns))
        console.print(shown)
        console.print(
            f"ours: {data}, {perception}" + (f"; paper: {table.paper_data}" if paper else ""), highlight=False
        )


def _print_curves(rows: Sequence[Mapping[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table

    from uppm.studies.noise import CURVES

    table = Table("sequence", "method", "noise", *(title for _, title in CURVES))
    for row in rows:
        values = ("-" if row[key] is None else f"{row[key]:.3f}" for key, _ in CURVES)
        table.add_row(row["sequence"], row["method"], f"{row['level']:g}", *values)
    Console().print(table)
