"""`uppm bench ablation`: what multi-resolution, belonging counters, interpolation and the presets bring."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

COLUMNS = {
    "accuracy, cm": lambda r: f"{r['accuracy_cm']:.2f}",
    "completeness, cm": lambda r: f"{r['completeness_cm']:.2f}",
    "within 5 cm, %": lambda r: f"{100 * r['completion_ratio_5cm']:.1f}",
    "things with one submap, %": lambda r: f"{100 * r['one_submap_ratio_things']:.1f}",
    "blocks": lambda r: str(r["blocks"]),
    "MB": lambda r: f"{r['map_mb']:.1f}",
    "ms a frame": lambda r: f"{r['ms_per_frame_median']:.1f}",
    "processor time, ms": lambda r: f"{r['cpu_ms_per_frame_median']:.1f}",
}
"""Column of the table -> what stands in it."""


def bench_ablation_command(
    sequence: Annotated[Path, typer.Option(help="Sequence with ground-truth segments and surface.npz.")],
    variant: Annotated[list[str] | None, typer.Option(help="One of the variants; repeat it; all if absent.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="A setting of all variants.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Accuracy, completeness, memory and time of a map with one setting changed at a time, and of `panmap`."""
    from uppm.bench.ablation import VARIANTS, ablation
    from uppm.core.errors import InputError

    for name in variant or ():
        if name not in VARIANTS:
            expected, advice = f"one of: {'; '.join(VARIANTS)}", "name one of these, or drop it"
            raise InputError("--variant", expected=expected, found=repr(name), advice=advice)
    result = ablation(sequence, variant or (), set_ or ())
    if as_json:
        typer.echo(json.dumps(result, indent=2))
    else:
        _print_table(result)


def _print_table(result: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("variant", *COLUMNS)
    for row in result["rows"]:
        table.add_row(row["variant"], *(cell(row) for cell in COLUMNS.values()))
    Console().print(table)
    typer.echo(", ".join(f"{name} {value}" for name, value in result["machine"].items()))
