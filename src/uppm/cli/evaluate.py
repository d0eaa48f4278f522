"""`uppm evaluate map`: reconstructions against the ground truth of a sequence."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from uppm.evaluation.map_evaluation import MapEvaluation

NESTED = ("matches", "per_class")
"""For programs only: they would not fit a table."""

evaluate_app = typer.Typer(help="Measure maps against ground truth (docs/evaluation.md).", no_args_is_help=True)


@evaluate_app.callback()
def evaluate() -> None:
    """Measure maps against ground truth (docs/evaluation.md)."""


@evaluate_app.command("map")
def evaluate_map_command(
    maps: Annotated[list[Path], typer.Argument(metavar="MAP|MESH...", help="Map files, or meshes of any system.")],
    ground_truth: Annotated[Path, typer.Option(help="Sequence in the `frames` layout, with surface.npz.")],
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON: one object, or a list for several maps.")
    ] = False,
    points_per_m2: Annotated[float, typer.Option(min=1, help="Sampling density of the reconstruction.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Of the sampling.")] = 0,
    min_pixels: Annotated[int, typer.Option(min=0, help="Instances seen in fewer pixels do not count.")] = 2000,
) -> None:
    """Accuracy, completeness and instances of one or several reconstructions."""
    from uppm.evaluation.ground_truth import load_surface_truth
    from uppm.evaluation.map_evaluation import evaluate_map
    from uppm.regimes import open_reconstruction

    truth = load_surface_truth(ground_truth)
    results = [
        evaluate_map(
            open_reconstruction(path),
            truth,
            points_per_m2=points_per_m2,
            seed=seed,
            min_pixels=min_pixels,
        )
        for path in maps
    ]
    if as_json:
        found = [result.to_dict() for result in results]
        typer.echo(json.dumps(found if len(found) > 1 else found[0], indent=2))
    else:
        _print_table(results)


def _print_table(results: list[MapEvaluation]) -> None:
    from rich.console import Console
    from rich.table import Table

    from uppm.evaluation.map_evaluation import METRIC_GROUPS

    table = Table("metric", *(Path(result.source).name for result in results))
    for part in METRIC_GROUPS:
        present = [getattr(result, part) for result in results]
        names = next(([f.name for f in fields(p) if f.name not in NESTED] for p in present if p is not None), [])
        for name in names:
            table.add_row(name, *(_shown(getattr(p, name, None)) for p in present))
        table.add_section()
    console = Console()
    console.print(table)
    console.print(f"ground truth: {results[0].ground_truth}; definitions: docs/evaluation.md")


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)
