"""`uppm demo`: the sequence that ships, mapped, asked and drawn."""

from __future__ import annotations

import time
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from uppm.map.panoptic_map import PanopticMap

PROMPTS = ("teddy bear", "television set", "sofa", "houseplant", "something to sit on", "bicycle")
"""Labels that the map holds, synonyms and paraphrases of them, and one thing that is not there."""


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the map, mesh and pictures.")] = Path(
        "out/demo"
    ),
    sequence: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Copy the sequence there, no more.")] = None,
) -> None:
    """Map the demo sequence that ships with the package, ask it questions, write and name the files."""
    if sequence:
        copy_sequence(sequence)
        return
    from uppm.cli.info import print_map
    from uppm.cli.map import print_report, run
    from uppm.cli.query import print_result
    from uppm.core.config import Config
    from uppm.datasets.registry import open_sequence
    from uppm.pipeline import open_map

    start = time.perf_counter()
    make_folder(output)
    file = output / "demo.uppm"
    with resources.as_file(resources.files("uppm.data") / "demo") as folder:
        report = run(open_sequence(folder), file, Config(), resume=False, overwrite=True, quiet=False)
    print_report(report, file)
    panoptic = open_map(file)
    print_map(panoptic)
    for prompt in PROMPTS:
        print_result(panoptic.query(prompt, limit=3))
    for written in (file, *write_files(panoptic, output)):
        typer.echo(str(written))
    typer.echo(f"done in {time.perf_counter() - start:.1f} s")


def copy_sequence(target: Path) -> None:
    """The sequence that ships as a folder of the user's own, and its name."""
    import shutil

    from uppm.core.folders import whole_folder

    with resources.as_file(resources.files("uppm.data") / "demo") as folder, whole_folder(target) as copy:
        shutil.copytree(folder, copy, dirs_exist_ok=True)
    typer.echo(f"{target}: {len(list((target / 'color').iterdir()))} frames")


def make_folder(path: Path) -> None:
    """Make a folder with those above it; raises `InputError` where that cannot be."""
    from uppm.core.errors import InputError

    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        found, advice = error.strerror or str(error), "name another with --output"
        raise InputError(path, expected="a folder to write to", found=found, advice=advice) from None


def write_files(panoptic: PanopticMap, output: Path) -> list[Path]:
    """The map's mesh, scene description and pictures; returns their names."""
    from uppm.cli.export import write_mesh_file
    from uppm.export.files import write_json, write_png
    from uppm.map.pictures import birds_eye, top_down

    mesh, scene = output / "mesh.glb", output / "scene.json"
    write_mesh_file(panoptic, mesh, "color")
    write_json(scene, panoptic.to_dict())
    pictures = {
        "top_down.png": top_down(panoptic),
        "view.png": birds_eye(panoptic),
        "instances.png": birds_eye(panoptic, coloring="instance"),
    }
    for name, image in pictures.items():
        write_png(output / name, image)
    return [mesh, scene, *(output / name for name in pictures)]
