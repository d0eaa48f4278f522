"""Exported files: read back by another program, written whole or not at all."""

from __future__ import annotations

import json
import resource
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from trimesh.visual.color import ColorVisuals
from trimesh.visual.texture import TextureVisuals

from tests.map.scenes import blocks_of, box, sphere, submap_of
from uppm.core.errors import InputError
from uppm.core.types import Mesh
from uppm.export.files import write_bytes, write_json, write_png
from uppm.export.meshes import write_meshes, write_objects, write_points
from uppm.map.mesh import empty_mesh, merged, submap_mesh

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def meshes() -> dict[str, Mesh]:
    submap = submap_of(1)
    shapes = {"1_cup": sphere((0, 0, 0), 0.2), "2_dining table": box((0.3, 0, 0), (0.5, 0.2, 0.2))}
    return {
        name: submap_mesh(submap, blocks_of(shape, (-0.3,) * 3, (0.7,) * 3, 0.02)) for name, shape in shapes.items()
    }


def assert_same(found: trimesh.Trimesh, expected: Mesh) -> None:
    np.testing.assert_allclose(found.vertices, expected.vertices, atol=1e-6)
    np.testing.assert_array_equal(found.faces, expected.faces)
    visual = found.visual
    if isinstance(visual, ColorVisuals):
        np.testing.assert_array_equal(np.asarray(visual.vertex_colors)[:, :3], expected.colors)
        return
    assert isinstance(visual, TextureVisuals)  # A GLB, which has a material and linear colours of 16 bits.
    linear = visual.vertex_attributes["color"][:, :3] / 65535
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.rint(255 * srgb), expected.colors)


def test_ply_round_trip(tmp_path: Path, meshes: dict[str, Mesh]) -> None:
    path = tmp_path / "scene.ply"
    write_meshes(path, meshes, up=UP)
    header = path.read_bytes().partition(b"end_header")[0]
    assert b"format binary_little_endian" in header
    assert b"property float nx" in header
    assert_same(trimesh.load_mesh(path, process=False), merged(list(meshes.values())))


def test_glb_round_trip_is_upright(tmp_path: Path, meshes: dict[str, Mesh]) -> None:
    path = tmp_path / "scene.glb"
    write_meshes(path, meshes, up=UP)
    scene = trimesh.load_scene(path, process=False)
    assert set(scene.graph.nodes_geometry) == set(meshes)
    for name, expected in meshes.items():
        pose, geometry = scene.graph.get(name)
        assert geometry is not None
        np.testing.assert_allclose(pose[:3, :3] @ UP, [0, 1, 0], atol=1e-7)
        assert_same(scene.geometry[geometry], expected)
        np.testing.assert_allclose(scene.geometry[geometry].vertex_normals, expected.normals, atol=1e-5)


def test_objects_become_a_file_each(tmp_path: Path, meshes: dict[str, Mesh]) -> None:
    folder = tmp_path / "objects"
    files = write_objects(folder, {**meshes, "3_ghost": empty_mesh()})
    assert [f.name for f in files] == ["1_cup.ply", "2_dining_table.ply"]
    assert sorted(folder.iterdir()) == files
    assert_same(trimesh.load_mesh(files[1], process=False), meshes["2_dining table"])


def test_png_is_rgb(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 255, (20, 30, 3)).astype(np.uint8)
    write_png(tmp_path / "a.png", image)
    found = cv2.imread(str(tmp_path / "a.png"))
    assert found is not None
    np.testing.assert_array_equal(found[..., ::-1], image)


def test_json(tmp_path: Path) -> None:
    write_json(tmp_path / "scene.json", {"label": "Tür", "center": [1.0, 2.0, 3.0]})
    assert json.loads((tmp_path / "scene.json").read_text())["label"] == "Tür"
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(tmp_path / "nan.json", {"x": float("nan")})


def test_wrong_destinations(tmp_path: Path, meshes: dict[str, Mesh]) -> None:
    with pytest.raises(InputError, match="nothing there; make it"):
        write_meshes(tmp_path / "absent" / "a.ply", meshes, up=UP)
    with pytest.raises(InputError, match=r"\.ply, \.glb or \.obj, found '\.stl'"):
        write_meshes(tmp_path / "a.stl", meshes, up=UP)
    with pytest.raises(InputError, match="with surfaces"):
        write_meshes(tmp_path / "a.ply", {}, up=UP)
    with pytest.raises(InputError, match="found a folder"):
        write_bytes(tmp_path, b"")
    with pytest.raises(InputError, match="nor its parent"):
        write_objects(tmp_path / "absent" / "objects", meshes)
    assert list(tmp_path.iterdir()) == []


def test_full_disk_keeps_the_older_file(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(b"older")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(InputError, match="room for the file"):
            write_bytes(path, bytes(200_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]


def test_obj_round_trip(tmp_path: Path, meshes: dict[str, Mesh]) -> None:
    path = tmp_path / "scene.obj"
    write_meshes(path, meshes, up=UP)
    text = path.read_text()
    assert [line[2:] for line in text.splitlines() if line.startswith("o ")] == list(meshes)
    found, expected = trimesh.load_mesh(path, process=False, maintain_order=True), merged(list(meshes.values()))
    assert len(found.faces) == len(expected.faces)
    np.testing.assert_allclose(found.triangles, expected.vertices[expected.faces], atol=1e-6)
    assert isinstance(found.visual, ColorVisuals)
    colors = np.asarray(found.visual.vertex_colors)[:, :3]
    np.testing.assert_array_equal(colors[found.faces], expected.colors[expected.faces])


def test_glb_nodes_carry_what_is_known_of_them(tmp_path: Path, meshes: dict[str, Mesh]) -> None:
    path = tmp_path / "scene.glb"
    extras = {name: {"category": name.split("_")[1], "labels": {"mug": 3}} for name in meshes}
    write_meshes(path, meshes, up=UP, extras=extras)
    data = path.read_bytes()
    tree = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert {node["name"]: node["extras"] for node in tree["nodes"]} == extras
    assert all(tree["meshes"][node["mesh"]]["name"] == node["name"] for node in tree["nodes"])


def test_glb_of_a_map_that_is_upright_keeps_its_coordinates(tmp_path: Path, meshes: dict[str, Mesh]) -> None:
    """With y up in the file: programs with z up turn it back by the same quarter."""
    path = tmp_path / "scene.glb"
    write_meshes(path, meshes, up=np.array([0.0, 0.0, 1.0]))
    found = trimesh.load_scene(path)
    quarter = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    for name, mesh in meshes.items():
        matrix, geometry = found.graph[name]
        vertices = trimesh.transform_points(found.geometry[str(geometry)].vertices, matrix) @ quarter.T
        np.testing.assert_allclose(vertices, mesh.vertices, atol=1e-6)


def test_points_come_back_with_their_fields(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(size=(50, 3)).astype(np.float32)
    fields = {"red": rng.integers(0, 255, 50).astype(np.uint8), "instance": np.arange(50, dtype=np.int32)}
    write_points(tmp_path / "a.ply", points, fields)
    cloud = trimesh.load(tmp_path / "a.ply")
    assert isinstance(cloud, trimesh.PointCloud)
    np.testing.assert_array_equal(cloud.vertices, points)
    rows = cloud.metadata["_ply_raw"]["vertex"]["data"]
    for name, values in fields.items():
        np.testing.assert_array_equal(rows[name], values)
    with pytest.raises(InputError, match=r"expected a name ending in \.ply"):
        write_points(tmp_path / "a.xyz", points, {})
