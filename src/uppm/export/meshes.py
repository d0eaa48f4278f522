"""Meshes as PLY and GLB files, with vertex colours and normals."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.exchange.ply import export_ply

from uppm.core.errors import InputError
from uppm.core.types import Mesh
from uppm.export.files import write_bytes

FORMATS = (".ply", ".glb")


def write_meshes(path: Path | str, meshes: Mapping[str, Mesh], *, up: npt.NDArray[np.float64]) -> None:
    """Several named meshes as one file: `.ply` (joined, binary, frame map) or `.glb` (a node each).

    glTF's up is +y: a GLB's root turns the map's `up` (3,) there, so that viewers show it upright.

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
    if path.suffix.lower() == ".ply":
        joined = trimesh.util.concatenate(list(parts.values())) if len(parts) > 1 else next(iter(parts.values()))
        data = export_ply(joined, encoding="binary", vertex_normal=True)
    elif path.suffix.lower() == ".glb":
        data = export_glb(_scene(parts, up), include_normals=True)
    else:
        expected = f"a name ending in {' or '.join(FORMATS)}"
        raise InputError(path, expected=expected, found=repr(path.suffix), advice="name the file so")
    write_bytes(path, data)


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
    turn = np.asarray(trimesh.geometry.align_vectors(up, [0.0, 1.0, 0.0]))
    for name, part in parts.items():
        scene.add_geometry(part, node_name=name, geom_name=name, transform=turn)
    return scene
