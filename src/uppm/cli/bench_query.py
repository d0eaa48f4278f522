"""`uppm bench query`: time of an answer on a large map, and of embedding a phrase."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer


def bench_query_command(
    objects: Annotated[int, typer.Option(min=1, help="Objects of the map.")] = 10_000,
    labels: Annotated[int, typer.Option(min=1, help="Labels an object, each a text of its own.")] = 3,
    repeat: Annotated[int, typer.Option(min=1, help="Times that each phrase is asked.")] = 20,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Time of a query after the phrase is embedded, and of embedding a phrase on the CPU."""
    from uppm.bench.query import bench_query

    result = bench_query(objects, labels, repeat)
    typer.echo(json.dumps(result, indent=2)) if as_json else _print(result)


def _print(result: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    embedding = result["embedding"]
    table = Table(
        f"{result['objects']} objects, {result['labels_an_object']} labels each", "median", "90 %", "processor"
    )
    for name, times in (("query, ms", result["query"]), ("embedding a phrase, ms", embedding)):
        if isinstance(times, dict):
            table.add_row(name, *(f"{times[key]:.1f}" for key in ("ms_median", "ms_p90", "cpu_ms_median")))
    Console().print(table)
    typer.echo(f"first query, which makes the matrices: {result['first_query_ms']:.0f} ms")
    if isinstance(embedding, str):
        typer.echo(f"embedding not measured: {embedding}")
    typer.echo(f"load {result['load_before']} before, {result['load_after']} after")
    typer.echo(", ".join(f"{name} {value}" for name, value in result["machine"].items()))
