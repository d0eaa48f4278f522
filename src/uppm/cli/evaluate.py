"""`uppm evaluate map`: reconstructions against the ground truth of a sequence."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from uppm.evaluation.map_evaluation import MapEvaluation
    from uppm.evaluation.sampling import SurfacePart

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

    truth = load_surface_truth(ground_truth)
    results = [
        evaluate_map(
            read_parts(path),
            truth,
            source=str(path),
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


def read_parts(path: Path) -> list[SurfacePart]:
    """The surfaces of a map file's submaps, freespace and tentative ones left out, or a mesh file's as one part."""
    from uppm.evaluation.sampling import SurfacePart

    if path.suffix.lower() == ".uppm":
        return _map_parts(path)
    from uppm.evaluation.meshes import read_mesh

    return [SurfacePart(id=1, mesh=read_mesh(path))]


def _map_parts(path: Path) -> list[SurfacePart]:
    from uppm.core.types import SubmapKind, SubmapState
    from uppm.evaluation.sampling import SurfacePart
    from uppm.pipeline import open_map

    panoptic_map = open_map(path)
    return [
        SurfacePart(
            id=submap.id,
            mesh=panoptic_map.submap_mesh(submap.id),
            category=submap.descriptor.category.name if submap.descriptor else None,
            is_object=submap.kind is SubmapKind.OBJECT,
            score=submap.descriptor.confidence if submap.descriptor else 0.0,
        )
        for submap in panoptic_map.submaps
        if submap.kind is not SubmapKind.FREESPACE and submap.state is not SubmapState.TENTATIVE
    ]


def _print_table(results: list[MapEvaluation]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("metric", *(Path(result.source).name for result in results))
    for part in ("geometry", "instances", "panoptic"):
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
