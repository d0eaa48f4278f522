"""`uppm export`: meshes, pictures and a scene description of a map."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from uppm.core.errors import InputError

if TYPE_CHECKING:
    from uppm.core.types import Mesh, Submap
    from uppm.map.panoptic_map import PanopticMap


class Coloring(str, Enum):
    COLOR = "color"
    INSTANCE = "instance"
    CATEGORY = "category"


def export(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    mesh: Annotated[Path | None, typer.Option(help="Mesh of the whole map, .ply or .glb.")] = None,
    color: Annotated[Coloring, typer.Option(help="What the mesh's and the pictures' colours show.")] = Coloring.COLOR,
    objects: Annotated[Path | None, typer.Option(metavar="DIR", help="One mesh an object: ID_CATEGORY.ply.")] = None,
    json: Annotated[Path | None, typer.Option(help="Scene description.")] = None,
    top_down: Annotated[Path | None, typer.Option(metavar="PNG", help="Picture from above, with names.")] = None,
    view: Annotated[Path | None, typer.Option(metavar="PNG", help="Bird's-eye picture.")] = None,
) -> None:
    """Write a map's meshes, pictures and scene description."""
    from uppm.pipeline import open_map

    if not any((mesh, objects, json, top_down, view)):
        advice = "add one, such as --mesh flat.ply"
        wanted = "--mesh, --objects, --json, --top-down or --view"
        raise InputError("export", expected=wanted, found="none of them", advice=advice)
    panoptic = open_map(path)
    written = _write_meshes(panoptic, mesh, objects, color.value)
    written += _write_pictures(panoptic, top_down, view, color.value)
    if json:
        from uppm.export.files import write_json

        write_json(json, panoptic.to_dict())
        written.append(json)
    for file in written:
        typer.echo(str(file))


def _write_meshes(panoptic: PanopticMap, mesh: Path | None, objects: Path | None, coloring: str) -> list[Path]:
    if not (mesh or objects):
        return []
    from uppm.export.meshes import write_objects

    written = []
    if mesh:
        write_mesh_file(panoptic, mesh, coloring)
        written.append(mesh)
    if objects:
        written += write_objects(objects, _meshes(panoptic, panoptic.objects, coloring))
    return written


def write_mesh_file(panoptic: PanopticMap, file: Path, coloring: str) -> None:
    """All surfaces of a map in one file, .ply or .glb."""
    from uppm.core.types import SubmapState
    from uppm.export.meshes import write_meshes

    shown = [s for s in panoptic.submaps if s.state is not SubmapState.TENTATIVE]
    write_meshes(file, _meshes(panoptic, shown, coloring), up=panoptic.up)


def _meshes(panoptic: PanopticMap, submaps: tuple[Submap, ...] | list[Submap], coloring: str) -> dict[str, Mesh]:
    kind = cast("Literal['color', 'instance', 'category']", coloring)
    return {
        f"{s.id}_{s.descriptor.category.name if s.descriptor else 'unlabeled'}": panoptic.submap_mesh(s.id, kind)
        for s in submaps
        if s.kind.value != "freespace"
    }


def _write_pictures(panoptic: PanopticMap, top: Path | None, view: Path | None, coloring: str) -> list[Path]:
    if not (top or view):
        return []
    from uppm.export.files import write_png
    from uppm.map.pictures import birds_eye, top_down

    kind = cast("Literal['color', 'instance', 'category']", coloring)
    written = []
    for file, draw in ((top, top_down), (view, birds_eye)):
        if file:
            write_png(file, draw(panoptic, coloring=kind))
            written.append(file)
    return written
