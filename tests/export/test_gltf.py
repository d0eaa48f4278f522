"""GLB files held to the Khronos validator, by node; its findings are seen to be findings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.export.gltf import assert_valid, validate
from tests.map.scenes import blocks_of, box, sphere, submap_of
from uppm.core.types import Mesh
from uppm.export.meshes import write_meshes
from uppm.map.mesh import empty_mesh, submap_mesh

EXTRAS = {"category": "cup", "labels": {"Größe": 3}, "center": [0.5, 0.0, 1.0], "none": None}


@pytest.fixture(scope="module")
def meshes() -> dict[str, Mesh]:
    shapes = {"1_cup": sphere((0, 0, 0), 0.2), '2_"Tür" \\ / 茶': box((0.3, 0, 0), (0.5, 0.2, 0.2))}
    return {
        name: submap_mesh(submap_of(1), blocks_of(shape, (-0.3,) * 3, (0.7,) * 3, 0.02, seed=1))
        for name, shape in shapes.items()
    }


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (0, -1, 0), (0.6, 0, 0.8)])
def test_the_validator_has_nothing_to_say(tmp_path: Path, meshes: dict[str, Mesh], up: tuple[float, ...]) -> None:
    file, parts = tmp_path / "scene.glb", {**meshes, "3_ghost": empty_mesh()}
    write_meshes(file, parts, up=np.array(up, dtype=float), extras={"1_cup": EXTRAS})
    info = assert_valid(file)
    assert info["drawCallCount"] == len(meshes)
    assert info["totalTriangleCount"] == sum(len(mesh.faces) for mesh in meshes.values())
    assert info["totalVertexCount"] == sum(len(mesh.vertices) for mesh in meshes.values())


def test_the_validator_finds_what_is_wrong(tmp_path: Path, meshes: dict[str, Mesh]) -> None:
    file = tmp_path / "scene.glb"
    write_meshes(file, meshes, up=np.array([0.0, 0.0, 1.0]))
    whole = file.read_bytes()
    for wrong, code in (
        (whole[:-8], "GLB_UNEXPECTED_END_OF_CHUNK_DATA"),
        (whole.replace(b'"componentType":5125', b'"componentType":5126', 1), "MESH_PRIMITIVE_INDICES_ACCESSOR_INVALID"),
        (whole.replace(b'"POSITION":', b'"POSITIOM":', 1), "MESH_PRIMITIVE_INVALID_ATTRIBUTE"),
    ):
        file.write_bytes(wrong)
        assert code in " ".join(message["code"] for message in validate(file)["issues"]["messages"])
