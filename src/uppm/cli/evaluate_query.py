"""`uppm evaluate query`: a map's answers to a list of prompts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from uppm.evaluation.prompts import Prompt, Wanted
    from uppm.map.panoptic_map import PanopticMap


def evaluate_query_command(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    prompts: Annotated[Path, typer.Option(metavar="FILE", help="Lines prompt<TAB>objects; no objects: not there.")],
    ground_truth: Annotated[Path | None, typer.Option(help="Sequence whose instances the objects are.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write a report there.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Top-1, recall and 'nothing here matches' over prompts for what is there and what is not."""
    from uppm.cli.evaluate_output import show
    from uppm.evaluation import html
    from uppm.evaluation.prompts import read_prompts
    from uppm.pipeline import open_map
    from uppm.regimes.query import ask, query_result
    from uppm.regimes.report import Report, make_folder

    asked, panoptic_map = read_prompts(prompts), open_map(path)
    if output:
        make_folder(output)
    wanted = _wanted(path, panoptic_map, asked, prompts, ground_truth)
    result = query_result(ask(panoptic_map, asked, wanted))
    headings = ["prompt", "objects", "answers", "probability", "right"]
    rows = [[a["prompt"], a["objects"], a["answers"], a["probability"], a["right"]] for a in result["answers"]]
    section = html.Section(title="Answers", body=html.table(headings, rows))
    report = Report(regime="query", title=f"Prompts of {prompts.name}", results={path.stem: result}, sections=[section])
    show(report, output, as_json=as_json)


def _wanted(
    path: Path, panoptic_map: PanopticMap, asked: list[Prompt], file: Path, ground_truth: Path | None
) -> Wanted:
    from uppm.evaluation.prompts import meant_categories, meant_instances
    from uppm.regimes.reconstructions import map_reconstruction

    reconstruction = map_reconstruction(panoptic_map, str(path))
    if ground_truth is None:
        return meant_categories(asked, reconstruction.parts, str(file))
    from uppm.evaluation.instances import main_instances
    from uppm.evaluation.map_evaluation import compare
    from uppm.regimes.ground_truth import open_truth

    truth = open_truth(ground_truth)
    comparison = compare(reconstruction, truth)
    owners = main_instances(comparison.samples, comparison.nearest, truth)
    return meant_instances(asked, truth, owners, str(file))
