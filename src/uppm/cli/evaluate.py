"""`uppm evaluate map`: reconstructions against the ground truth of a sequence."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

evaluate_app = typer.Typer(help="Measure maps against ground truth (docs/evaluation.md).", no_args_is_help=True)


@evaluate_app.callback()
def evaluate() -> None:
    """Measure maps against ground truth (docs/evaluation.md)."""


@evaluate_app.command("map")
def evaluate_map_command(
    maps: Annotated[list[Path], typer.Argument(metavar="MAP|MESH...", help="Map files, or meshes of any system.")],
    ground_truth: Annotated[Path, typer.Option(help="Sequence or scan with ground truth.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write a report there.")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON: one object, or a list for several maps.")
    ] = False,
    points_per_m2: Annotated[float, typer.Option(min=1, help="Sampling density of the reconstruction.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Of the sampling.")] = 0,
    min_pixels: Annotated[int, typer.Option(min=0, help="Instances seen in fewer pixels do not count.")] = 2000,
    align: Annotated[bool, typer.Option("--align", help="Move reconstructions onto the ground truth (ICP).")] = False,
) -> None:
    """Accuracy, completeness and instances of one or several reconstructions (Map-to-Map)."""
    from uppm.cli.evaluate_output import show, unique_names
    from uppm.evaluation.map_evaluation import compare, measure
    from uppm.regimes.ground_truth import open_truth
    from uppm.regimes.reconstructions import open_reconstruction
    from uppm.regimes.report import Report, make_folder

    if output:
        make_folder(output)
    truth = open_truth(ground_truth)
    names = unique_names(maps)
    comparisons = {
        name: compare(open_reconstruction(path), truth, points_per_m2=points_per_m2, seed=seed, align=align)
        for name, path in zip(names, maps, strict=True)
    }
    report = Report(
        regime="map",
        title=f"Map-to-Map: {Path(truth.source).name}",
        results={name: measure(comparison, min_pixels).to_dict() for name, comparison in comparisons.items()},
        comparisons=comparisons,
    )
    show(report, output, as_json=as_json)
