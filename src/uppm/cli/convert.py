"""`uppm convert`: other segmenters' output into the folder of the profile `precomputed`; a sequence into a bag."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

convert_app = typer.Typer(help="Other segmenters' output and sequences, in other formats.", no_args_is_help=True)


@convert_app.callback()
def convert() -> None:
    """Other segmenters' output and sequences, in other formats."""


@convert_app.command("coco-panoptic")
def coco_panoptic(
    annotations: Annotated[Path, typer.Argument(metavar="ANNOTATIONS.json", help="images, annotations, categories.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to make.")],
    images: Annotated[
        Path | None, typer.Option(help="Folder of the PNG files, if it is not named as the JSON.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """COCO panoptic JSON and PNG, as MaskDINO, OpenSeeD and OMG-Seg write, into a folder for `--precomputed`."""
    from uppm.perception.segmentation.coco_panoptic import convert_coco_panoptic

    done = convert_coco_panoptic(annotations, images, output)
    if as_json:
        typer.echo(json.dumps({"folder": str(output), **asdict(done)}, indent=2))
        return
    dropped = "".join(f"; left out: {count} {reason}" for reason, count in done.dropped.items())
    typer.echo(f"{output}: {done.frames} frames, {done.segments} segments{dropped}")


@convert_app.command("bag")
def bag(
    sequence: Annotated[Path, typer.Argument(readable=False, help="Folder or file of a posed RGB-D sequence.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Bag's folder to make.")],
    set_: Annotated[list[str] | None, typer.Option("--set", help="One setting, as input.stride=2.")] = None,
) -> None:
    """A posed RGB-D sequence into a ROS 2 bag, as a robot with a depth camera records it."""
    from uppm.core.config import Config
    from uppm.datasets import open_sequence
    from uppm.datasets.bags.writer import write_bag

    count = write_bag(open_sequence(sequence, Config.load(overrides=set_ or []).input), output)
    typer.echo(f"{output}: {count} frames")
