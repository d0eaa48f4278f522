"""`uppm evaluate query`: a map's answers to a list of prompts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from uppm.evaluation.language import PromptOutcome
    from uppm.evaluation.prompts import Prompt, Wanted
    from uppm.map.panoptic_map import PanopticMap
    from uppm.regimes.report import Report


def evaluate_query_command(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    prompts: Annotated[Path, typer.Option(metavar="FILE", help="Lines prompt<TAB>objects; no objects: not there.")],
    ground_truth: Annotated[Path | None, typer.Option(help="Sequence whose instances the objects are.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write a report there.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Top-1, recall and 'nothing here matches' over prompts for what is there and what is not."""
    from uppm.cli.evaluate_output import show
    from uppm.evaluation.prompts import read_prompts
    from uppm.pipeline import open_map
    from uppm.regimes.query import ask, query_result
    from uppm.regimes.report import Report, make_folder

    asked, panoptic_map = read_prompts(prompts), open_map(path)
    if output:
        make_folder(output)
    wanted = _wanted(path, panoptic_map, asked, prompts, ground_truth)
    outcomes = ask(panoptic_map, asked, wanted)
    results, title = {path.stem: query_result(outcomes)}, f"Prompts of {prompts.name}"
    report = Report(regime="query", title=title, results=results)
    if output:
        report = _with_pictures(report, path.stem, panoptic_map, outcomes)
    show(report, output, as_json=as_json)


def _with_pictures(report: Report, name: str, panoptic_map: PanopticMap, outcomes: Sequence[PromptOutcome]) -> Report:
    from uppm.evaluation import html, plots
    from uppm.regimes.query import Found, draw_answers
    from uppm.regimes.report import ReportPicture

    headings = ["prompt", "objects", "answers", "probability", "right"]
    answers = report.results[name]["answers"]
    said = ({**answer, "answers": ", ".join(map(str, answer["answers"]))} for answer in answers)
    table = html.table(headings, [[answer[heading] for heading in headings] for answer in said], text=3)
    plot = plots.answer_probabilities(
        [o.probability for o in outcomes if not o.is_absent], [o.probability for o in outcomes if o.is_absent]
    )
    caption = "The further apart the two, the better 'nothing here matches' can be told."
    legend = html.legend((found.value, found.meaning) for found in Found)
    picture = ReportPicture(file=f"{name}_answers.png", image=draw_answers(panoptic_map, outcomes), caption=legend)
    return replace(
        report,
        pictures={"What was found": [picture]},
        sections=[
            html.Section(title="Probabilities", body=html.image(plot, "image/svg+xml", caption)),
            html.Section(title="Answers", body=table),
        ],
    )


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
