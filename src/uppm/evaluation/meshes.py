"""Meshes and point clouds of any system, read by trimesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from uppm.core.errors import InputError
from uppm.core.types import Mesh


def read_mesh(file: Path) -> Mesh:
    """A PLY, GLB, OBJ, STL or OFF file, metres; a point cloud has no faces. Raises `InputError` naming the file."""
    expected = "a mesh or point cloud (PLY, GLB, OBJ, STL, OFF)"
    if not file.is_file():
        raise InputError(
            file, expected=expected, found="a folder" if file.is_dir() else "no such file", advice="name a file"
        )
    try:
        loaded = trimesh.load(file, process=False)
    except (ValueError, KeyError, IndexError, TypeError, NotImplementedError, OSError) as error:
        found = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(file, expected=expected, found=found, advice="export it again") from None
    geometry = loaded.to_geometry() if isinstance(loaded, trimesh.Scene) else loaded
    vertices = np.asarray(getattr(geometry, "vertices", np.empty((0, 3))), dtype=np.float32)
    faces = np.asarray(getattr(geometry, "faces", np.empty((0, 3))), dtype=np.int32)
    if not len(vertices):
        raise InputError(file, expected=expected, found="one without vertices", advice="export it again")
    # Neither is measured; reading them from every format is not worth its errors.
    normals, colors = np.zeros_like(vertices), np.zeros(vertices.shape, dtype=np.uint8)
    return Mesh(vertices=vertices, normals=normals, colors=colors, faces=faces)
