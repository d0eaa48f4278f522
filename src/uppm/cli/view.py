"""`uppm view`: a map in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from uppm.core.protocols import FrameSource
    from uppm.map.panoptic_map import PanopticMap


def view(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    export: Annotated[Path, typer.Option(metavar="HTML", help="Write one file that needs no program.")],
    sequence: Annotated[
        Path | None, typer.Option(help="The sequence that the map was made of, for pictures of its objects.")
    ] = None,
) -> None:
    """Look at a map: its objects, what is known of them, and answers to prompts."""
    from uppm.pipeline import open_map

    panoptic = open_map(path)
    source = open_source(panoptic, path, sequence) if sequence else None
    export_page(panoptic, export, path.stem, source)


def open_source(panoptic: PanopticMap, path: Path, sequence: Path) -> FrameSource:
    """The sequence of a map, read as it was read for mapping; raises `InputError` where it is another."""
    from uppm.pipeline import check_same, open_sequence, saved_config

    source = open_sequence(sequence, saved_config(panoptic.meta).input)
    check_same(panoptic.meta, source, path)
    return source


def export_page(panoptic: PanopticMap, file: Path, title: str, source: FrameSource | None) -> None:
    """Write a map as one HTML file."""
    from uppm.core.errors import InputError
    from uppm.export.files import write_bytes
    from uppm.map.shown import content_of
    from uppm.viewer.crops import best_crops
    from uppm.viewer.html import map_page

    if file.suffix.lower() not in (".html", ".htm"):
        expected = "a name ending in .html"
        raise InputError(file, expected=expected, found=repr(file.suffix), advice="name the file so")
    content = content_of(panoptic, title)
    crops = {}
    if source is not None:
        found = best_crops({s.submap.id: s.mesh for s in content.shown if s.is_object}, content.path, source)
        crops = {id_: [crop.jpeg() for crop in views] for id_, views in found.items()}
    write_bytes(file, map_page(content, crops).encode())
    typer.echo(str(file))
