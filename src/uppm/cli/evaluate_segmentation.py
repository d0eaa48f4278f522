"""`uppm evaluate segmentation`: front ends on 2D frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def evaluate_segmentation_command(
    sequence: Annotated[Path, typer.Argument(readable=False, help="Sequence with instance images.")],
    perception: Annotated[str, typer.Option(metavar="A,B,...", help="Front ends, with commas between.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write a report there.")] = None,
    config: Annotated[str | None, typer.Option(help="YAML file of settings, or a preset.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="One setting, as perception.masks=box.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: one object, or a list for several.")] = False,
) -> None:
    """Panoptic quality of front ends on the frames themselves (Segmentation-to-Segmentation)."""
    from uppm.cli.evaluate_output import front_ends, show
    from uppm.datasets.registry import open_sequence
    from uppm.evaluation.ground_truth import load_instances
    from uppm.regimes.report import Report, frame_pictures, make_folder
    from uppm.regimes.segmentation import evaluate_segmenter

    settings = front_ends(perception, config, set_ or [])
    if output:
        make_folder(output)
    instances = load_instances(sequence)
    results, pictures = {}, {}
    for name, chosen in settings.items():
        results[name], drawn = evaluate_segmenter(open_sequence(sequence, chosen.input), instances, chosen)
        pictures[f"Where {name} is wrong"] = frame_pictures(name, drawn)
    title = f"Segmentation-to-Segmentation: {sequence.resolve().name}"
    show(Report(regime="segmentation", title=title, results=results, pictures=pictures), output, as_json=as_json)
