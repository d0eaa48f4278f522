"""`uppm evaluate sequence`: one fusion fed by several front ends."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer


def evaluate_sequence_command(
    sequence: Annotated[Path, typer.Argument(readable=False, help="Sequence with ground truth.")],
    perception: Annotated[str, typer.Option(metavar="A,B,...", help="Front ends, with commas between.")],
    ground_truth: Annotated[Path | None, typer.Option(help="Where that is; else in the sequence.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write a report there.")] = None,
    config: Annotated[str | None, typer.Option(help="YAML file of settings, or a preset.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="One setting, as fusion.truncation=3.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: one object, or a list for several.")] = False,
    points_per_m2: Annotated[float, typer.Option(min=1, help="Sampling density of the maps.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Of the sampling.")] = 0,
    min_pixels: Annotated[int, typer.Option(min=0, help="Instances seen in fewer pixels do not count.")] = 2000,
) -> None:
    """Map a sequence with several front ends and measure the maps (Segmentation-to-Map)."""
    from uppm.cli.evaluate_output import front_ends, show
    from uppm.datasets.registry import open_sequence
    from uppm.regimes.ground_truth import open_truth
    from uppm.regimes.report import Report, make_folder
    from uppm.regimes.sequence import evaluate_front_end

    settings = front_ends(perception, config, set_ or [])
    if output:
        make_folder(output)
    truth = open_truth(ground_truth or sequence, sequence)
    results, comparisons = {}, {}
    with ExitStack() as stack:
        folder = output or Path(stack.enter_context(TemporaryDirectory(prefix="uppm-")))
        for name, chosen in settings.items():
            source = open_sequence(sequence, chosen.input)
            results[name], comparisons[name] = evaluate_front_end(
                source,
                truth,
                chosen,
                folder / f"{name}.uppm",
                points_per_m2=points_per_m2,
                seed=seed,
                min_pixels=min_pixels,
            )
        title = f"Segmentation-to-Map: {Path(truth.source).name}"
        report = Report(regime="sequence", title=title, results=results, comparisons=comparisons)
        show(report, output, as_json=as_json)
