"""Meshes as PLY, GLB and OBJ files, with vertex colours and normals; point clouds as PLY."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.exchange.obj import export_obj
from trimesh.exchange.ply import export_ply

from uppm.core.errors import InputError
from uppm.core.geometry import upright
from uppm.core.types import Mesh
from uppm.export.colors import linear_light
from uppm.export.files import write_bytes

FORMATS = (".ply", ".glb", ".obj")
_ARRAY, _ELEMENT_ARRAY = 34962, 34963
"""glTF's numbers for buffers of vertices and of indices."""
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From z up to y up, as programs that have z up turn it back: they show the coordinates of a map whose up is z."""
_UNSIGNED_SHORT, _FULL = 5123, 65535
"""glTF's number for 16 bits, and their greatest value."""


def write_meshes(
    path: Path | str,
    meshes: Mapping[str, Mesh],
    *,
    up: npt.NDArray[np.float64],
    extras: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Several named meshes as one file: `.ply` (joined, binary, frame map), `.obj` (a group each, frame map) or `.glb`.

    A GLB has a node each. glTF's up is +y: its nodes turn the map's `up` (3,) there, so that viewers show it upright.
    `extras` are written with their nodes, as glTF extras.

    Raises
    ------
    InputError
        The ending is another, there is no triangle at all, or the file cannot be written.
    """
    path = Path(path)
    meshes = {name: mesh for name, mesh in meshes.items() if len(mesh.faces)}
    if not meshes:
        raise InputError(path, expected="a map with surfaces", found="none", advice="map more frames, then export")
    parts = {name: _trimesh(mesh) for name, mesh in meshes.items()}
    ending = path.suffix.lower()
    if ending not in FORMATS:
        expected = f"a name ending in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}"
        raise InputError(path, expected=expected, found=repr(path.suffix), advice="name the file so")
    if ending == ".ply":
        joined = trimesh.util.concatenate(list(parts.values())) if len(parts) > 1 else next(iter(parts.values()))
        data = export_ply(joined, encoding="binary", vertex_normal=True)
    elif ending == ".obj":
        data = export_obj(trimesh.Scene({**parts}), include_normals=True, include_color=True).encode()
    else:
        scene = _scene(parts, up)
        data = export_glb(
            scene,
            include_normals=True,
            buffer_postprocessor=_linearize,
            tree_postprocessor=lambda tree: _complete(tree, extras or {}),
        )
    write_bytes(path, data)


def write_points(path: Path | str, points: npt.NDArray[np.float32], fields: Mapping[str, npt.NDArray[Any]]) -> None:
    """Points (N, 3), frame map, metres, as a binary `.ply` with further fields (N,) each, such as red and instance."""
    path = Path(path)
    if path.suffix.lower() != ".ply":
        raise InputError(path, expected="a name ending in .ply", found=repr(path.suffix), advice="name the file so")
    kinds = {"f": "float", "u1": "uchar", "i4": "int", "i2": "short"}
    columns = {**{axis: points[:, k].astype("<f4") for k, axis in enumerate("xyz")}, **fields}
    rows = np.empty(len(points), dtype=[(name, column.dtype.newbyteorder("<")) for name, column in columns.items()])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    for name, column in columns.items():
        rows[name] = column
        kind = kinds["f" if column.dtype.kind == "f" else column.dtype.str[1:]]
        header.append(f"property {kind} {name}")
    write_bytes(path, ("\n".join([*header, "end_header"]) + "\n").encode() + rows.tobytes())


def write_objects(folder: Path | str, meshes: Mapping[str, Mesh]) -> list[Path]:
    """One PLY a mesh, named after it, in a folder that is made if its parent exists; returns the files."""
    folder = Path(folder)
    if not folder.parent.is_dir() or (folder.exists() and not folder.is_dir()):
        raise InputError(folder, expected="a folder", found="none, nor its parent", advice="make it or name another")
    folder.mkdir(exist_ok=True)
    written = []
    for name, mesh in meshes.items():
        if len(mesh.faces):
            written.append(folder / f"{file_name(name)}.ply")
            write_meshes(written[-1], {name: mesh}, up=np.array([0.0, 0.0, 1.0]))
    return written


def file_name(name: str) -> str:
    """A name with all but letters, digits, `-`, `_` and `.` as `_`."""
    return re.sub(r"[^\w.-]+", "_", name)


def _trimesh(mesh: Mesh) -> trimesh.Trimesh:
    colors = np.column_stack([mesh.colors, np.full(len(mesh.colors), 255, np.uint8)])
    return trimesh.Trimesh(
        vertices=mesh.vertices,
        faces=mesh.faces,
        vertex_normals=mesh.normals,
        vertex_colors=colors,
        process=False,
        validate=False,
    )


def _scene(parts: Mapping[str, trimesh.Trimesh], up: npt.NDArray[np.float64]) -> trimesh.Scene:
    scene = trimesh.Scene()
    turn = np.eye(4)
    turn[:3, :3] = _Y_UP @ upright(up)
    for name, part in parts.items():
        scene.add_geometry(part, node_name=name, geom_name=name, transform=turn)
    return scene


def _linearize(buffers: dict[Any, bytes], tree: dict[str, Any]) -> None:
    """Turn the vertex colours of a glTF document from sRGB bytes into linear light of 16 bits, as glTF has them."""
    keys, accessors = list(buffers), list(tree["accessors"].values())
    primitives = [primitive for mesh in tree["meshes"] for primitive in mesh["primitives"]]
    # Meshes of the same colours share one buffer.
    for number in {primitive["attributes"]["COLOR_0"] for primitive in primitives}:
        key = keys[accessors[number]["bufferView"]]
        rgba = np.frombuffer(buffers[key], dtype=np.uint8).reshape(-1, 4)
        out = np.full(rgba.shape, _FULL, dtype="<u2")
        out[:, :3] = np.rint(linear_light(rgba[:, :3]) * _FULL)
        buffers[key], accessors[number]["componentType"] = out.tobytes(), _UNSIGNED_SHORT
        for bound in ("min", "max"):
            accessors[number].pop(bound, None)


def _complete(tree: dict[str, Any], extras: Mapping[str, Mapping[str, Any]]) -> None:
    """Add what trimesh leaves out of a glTF document: the nodes' extras, what buffers are for, and a matt material.

    Without a material, glTF's default is bare metal, which a viewer without surroundings to mirror shows black.
    """
    matt = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    tree["materials"] = [{"name": "matt", "pbrMetallicRoughness": matt}]
    for node in tree["nodes"]:
        if node.get("name") in extras:
            node["extras"] = dict(extras[node["name"]])
    for primitive in (primitive for mesh in tree["meshes"] for primitive in mesh["primitives"]):
        primitive["material"] = 0
        tree["bufferViews"][tree["accessors"][primitive["indices"]]["bufferView"]]["target"] = _ELEMENT_ARRAY
        for accessor in primitive["attributes"].values():
            tree["bufferViews"][tree["accessors"][accessor]["bufferView"]]["target"] = _ARRAY
