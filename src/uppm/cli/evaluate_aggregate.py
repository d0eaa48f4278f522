"""`uppm evaluate aggregate`: the results of several sequences as one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def evaluate_aggregate_command(
    files: Annotated[list[Path], typer.Argument(metavar="REPORT.json...", help="A report.json a sequence.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write a report there.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: one object, or a list.")] = False,
) -> None:
    """Averages over sequences, weighted by the surface that each of them saw."""
    from uppm.cli.evaluate_output import show
    from uppm.evaluation import html, plots
    from uppm.evaluation.aggregate import aggregate, read_results
    from uppm.regimes.report import Report, make_folder

    combined = aggregate([result for file in files for result in read_results(file)])
    sections: list[html.Section] = []
    if output:
        make_folder(output)
        chart = html.image(plots.summary_chart(combined), "image/svg+xml", "Weighted averages over the sequences.")
        sections = [html.Section(title="Over all sequences", body=chart)]
    title = f"{len(files)} sequences: weighted averages"
    show(Report(regime="aggregate", title=title, results=combined, sections=sections), output, as_json=as_json)
