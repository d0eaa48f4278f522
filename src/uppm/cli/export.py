"""`uppm export`: meshes, clouds, pictures, a scene description, and grids to navigate by."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from uppm.cli.navigation import write_grids
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
    mesh: Annotated[Path | None, typer.Option(help="Mesh of the whole map, .ply, .glb, .obj or .usd.")] = None,
    color: Annotated[Coloring, typer.Option(help="What the mesh's and the pictures' colours show.")] = Coloring.COLOR,
    points: Annotated[Path | None, typer.Option(metavar="PLY", help="Cloud with instance and category.")] = None,
    objects: Annotated[Path | None, typer.Option(metavar="DIR", help="One mesh an object: ID_CATEGORY.ply.")] = None,
    json: Annotated[Path | None, typer.Option(help="Scene description.")] = None,
    scene_graph: Annotated[Path | None, typer.Option(help="Objects, rooms and relations, JSON.")] = None,
    top_down: Annotated[Path | None, typer.Option(metavar="PNG", help="Picture from above, with names.")] = None,
    view: Annotated[Path | None, typer.Option(metavar="PNG", help="Bird's-eye picture.")] = None,
    occupancy: Annotated[Path | None, typer.Option(metavar="YAML", help="Plan for ROS's map_server.")] = None,
    costmap: Annotated[Path | None, typer.Option(metavar="YAML", help="Costs by category, map_server raw.")] = None,
    esdf: Annotated[Path | None, typer.Option(metavar="NPZ", help="Distances in 3D, and in the band.")] = None,
    resolution: Annotated[float, typer.Option(min=0.005, help="Cells of the grids, metres.")] = 0.05,
    band: Annotated[tuple[float, float], typer.Option(help="Heights over the floor, metres.")] = (0.1, 1.5),
    inflation: Annotated[list[str] | None, typer.Option(metavar="NAME=METRES", help="Of a category.")] = None,
) -> None:
    """Write a map's meshes, clouds, pictures, scene description, scene graph and navigation grids."""
    from uppm.pipeline import open_map

    if not any((mesh, points, objects, json, scene_graph, top_down, view, occupancy, costmap, esdf)):
        wanted = (
            "--mesh, --points, --objects, --json, --scene-graph, --top-down, --view, --occupancy, --costmap or --esdf"
        )
        raise InputError("export", expected=wanted, found="none of them", advice="add one, such as --mesh flat.ply")
    panoptic = open_map(path)
    written = _write_meshes(panoptic, mesh, objects, color.value)
    written += _write_points(panoptic, points)
    written += _write_pictures(panoptic, top_down, view, color.value)
    written += _write_scene(panoptic, json, scene_graph)
    written += write_grids(panoptic, occupancy, costmap, esdf, resolution, band, inflation or [])
    for file in written:
        typer.echo(str(file))


def _write_meshes(panoptic: PanopticMap, mesh: Path | None, objects: Path | None, coloring: str) -> list[Path]:
    if not (mesh or objects):
        return []
    from uppm.export.files import write_json
    from uppm.export.meshes import write_objects

    written = []
    if mesh:
        write_mesh_file(panoptic, mesh, coloring)
        written.append(mesh)
    if objects:
        written += write_objects(objects, _meshes(panoptic, panoptic.objects, coloring))
        written.append(objects / "boxes.json")
        write_json(written[-1], {"boxes": _boxes(panoptic)})
    return written


def write_mesh_file(panoptic: PanopticMap, file: Path, coloring: str) -> None:
    """All surfaces of a map in one file, .ply, .glb, .obj or USD."""
    from uppm.core.types import SubmapState
    from uppm.export import usd
    from uppm.export.meshes import write_meshes
    from uppm.map.panoptic_map import submap_dict

    shown = [s for s in panoptic.submaps if s.state is not SubmapState.TENTATIVE]
    extras = {_mesh_name(s): submap_dict(s) for s in shown}
    meshes = _meshes(panoptic, shown, coloring)
    if file.suffix.lower() in usd.FORMATS:
        usd.write_usd(file, meshes, up=panoptic.up, extras=extras)
    else:
        write_meshes(file, meshes, up=panoptic.up, extras=extras)


def _mesh_name(submap: Submap) -> str:
    return f"{submap.id}_{submap.descriptor.category.name if submap.descriptor else 'unlabeled'}"


def _meshes(panoptic: PanopticMap, submaps: tuple[Submap, ...] | list[Submap], coloring: str) -> dict[str, Mesh]:
    kind = cast("Literal['color', 'instance', 'category']", coloring)
    return {_mesh_name(s): panoptic.submap_mesh(s.id, kind) for s in submaps if s.kind.value != "freespace"}


def _write_scene(panoptic: PanopticMap, description: Path | None, graph: Path | None) -> list[Path]:
    from uppm.export.files import write_json

    if description:
        write_json(description, {**panoptic.to_dict(), "boxes": _boxes(panoptic)})
    if graph:
        from uppm.map.scene_graph import scene_graph

        write_json(graph, scene_graph(panoptic))
    return [file for file in (description, graph) if file]


def _boxes(panoptic: PanopticMap) -> list[dict[str, Any]]:
    """Each object's upright box, by its id."""
    from uppm.map.boxes import upright_box

    found = [(s.id, upright_box(panoptic.submap_mesh(s.id).vertices, panoptic.up)) for s in panoptic.objects]
    return [{"id": id_, **box.to_dict()} for id_, box in found if box]


def _write_points(panoptic: PanopticMap, file: Path | None) -> list[Path]:
    """The vertices of all surfaces, with normal, colour, submap id and unified category id (0: unlabeled)."""
    if file is None:
        return []
    import numpy as np

    from uppm.core.types import SubmapState
    from uppm.export.meshes import write_points

    shown = [s for s in panoptic.submaps if s.state is not SubmapState.TENTATIVE]
    meshes = [panoptic.submap_mesh(s.id) for s in shown]
    counts = [len(mesh.vertices) for mesh in meshes]
    normals, colors = (np.concatenate([getattr(m, name) for m in meshes]) for name in ("normals", "colors"))
    categories = [s.descriptor.category.id if s.descriptor else 0 for s in shown]
    fields = {name: normals[:, k] for k, name in enumerate(("nx", "ny", "nz"))}
    fields |= {name: colors[:, k] for k, name in enumerate(("red", "green", "blue"))}
    fields["instance"] = np.repeat([s.id for s in shown], counts).astype(np.int32)
    fields["category"] = np.repeat(categories, counts).astype(np.int32)
    write_points(file, np.concatenate([mesh.vertices for mesh in meshes]), fields)
    return [file]


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
