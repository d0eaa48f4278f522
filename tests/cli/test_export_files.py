"""Every file of `uppm export` of one mapped room, read by other programs and held against the map."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial import KDTree
from typer.testing import CliRunner

from tests.cli.conftest import Uppm
from tests.export.gltf import assert_valid
from uppm.cli.main import app
from uppm.core.geometry import upright
from uppm.core.types import Mesh
from uppm.map.panoptic_map import PanopticMap
from uppm.pipeline import open_map

FILES = {
    "--mesh": "room.ply",
    "--points": "cloud.ply",
    "--objects": "objects",
    "--json": "room.json",
    "--occupancy": "plan.yaml",
    "--costmap": "cost.yaml",
    "--esdf": "room.npz",
}


@dataclass(frozen=True, kw_only=True)
class Exported:
    folder: Path
    panoptic: PanopticMap
    whole: Mesh

    def picture(self, name: str) -> tuple[np.ndarray, dict]:
        """Cells (X, Y) of a map_server picture, and its YAML."""
        meta = yaml.safe_load((self.folder / name).read_text())
        grey = cv2.imread(str(self.folder / meta["image"]), cv2.IMREAD_UNCHANGED)
        assert grey is not None
        return grey[::-1].T, meta


@pytest.fixture(scope="module")
def exported(map_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    folder, panoptic = tmp_path_factory.mktemp("exported"), open_map(map_file)
    options = [str(part) for key, name in FILES.items() for part in (key, folder / name)]
    done = CliRunner().invoke(app, ["export", str(map_file), *options], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return Exported(folder=folder, panoptic=panoptic, whole=panoptic.mesh())


def test_meshes_in_each_format_are_one_surface(uppm: Uppm, exported: Exported, map_file: Path) -> None:
    expected = exported.whole.vertices[exported.whole.faces].mean(axis=1)
    turned = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) @ upright(exported.panoptic.up)
    for name, R in (("room.ply", np.eye(3)), ("room.obj", np.eye(3)), ("room.glb", turned)):
        file = exported.folder / name
        assert name == "room.ply" or uppm("export", map_file, "--mesh", file).code == 0
        mesh = trimesh.load_scene(file, process=False).to_mesh()
        assert len(mesh.faces) == len(expected)
        assert KDTree(mesh.triangles.mean(axis=1) @ R).query(expected)[0].max() < 1e-5


@pytest.mark.parametrize("color", ["color", "instance", "category"])
def test_glb_of_a_map_is_valid(uppm: Uppm, map_file: Path, tmp_path: Path, color: str) -> None:
    file = tmp_path / "room.glb"
    assert uppm("export", map_file, "--mesh", file, "--color", color).code == 0
    assert assert_valid(file)["totalTriangleCount"] == len(open_map(map_file).mesh().faces)


def test_plyfile_reads_mesh_and_cloud(exported: Exported) -> None:
    plyfile = pytest.importorskip("plyfile", reason="needs `pip install plyfile` (extra dev)")
    mesh = plyfile.PlyData.read(exported.folder / "room.ply")
    np.testing.assert_array_equal(np.stack(mesh["face"]["vertex_indices"]), exported.whole.faces)
    cloud = plyfile.PlyData.read(exported.folder / "cloud.ply")["vertex"]
    for rows in (mesh["vertex"], cloud):
        for names, expected in (("xyz", exported.whole.vertices), (("nx", "ny", "nz"), exported.whole.normals)):
            np.testing.assert_allclose(np.column_stack([rows[n] for n in names]), expected, atol=1e-6)
        colors = np.column_stack([rows[n] for n in ("red", "green", "blue")])
        np.testing.assert_array_equal(colors, exported.whole.colors)
    for submap in exported.panoptic.submaps:
        own = cloud["instance"] == submap.id
        assert own.sum() == len(exported.panoptic.submap_mesh(submap.id).vertices)
        assert set(cloud["category"][own]) <= {submap.descriptor.category.id if submap.descriptor else 0}


def test_each_object_is_in_its_box(exported: Exported) -> None:
    boxes = {box["id"]: box for box in json.loads((exported.folder / "room.json").read_text())["boxes"]}
    files = {int(file.name.split("_")[0]): file for file in (exported.folder / "objects").glob("*.ply")}
    beside = json.loads((exported.folder / "objects" / "boxes.json").read_text())
    assert {box["id"]: box for box in beside["boxes"]} == boxes
    assert set(boxes) == set(files) == {submap.id for submap in exported.panoptic.objects}
    for id_, file in files.items():
        mesh, box = trimesh.load_mesh(file, process=False), boxes[id_]
        np.testing.assert_allclose(mesh.vertices, exported.panoptic.submap_mesh(id_).vertices, atol=1e-6)
        axes = np.array(box["axes"])
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-5)
        assert axes[2] @ exported.panoptic.up == pytest.approx(1, abs=1e-5)
        local = (mesh.vertices - box["center"]) @ axes.T
        np.testing.assert_allclose(local.max(axis=0), np.array(box["size"]) / 2, atol=1e-3)
        np.testing.assert_allclose(local.min(axis=0), -np.array(box["size"]) / 2, atol=1e-3)


def test_distances_are_to_the_nearest_occupied_cell(exported: Exported) -> None:
    with np.load(exported.folder / "room.npz") as file:
        esdf = dict(file)
    for state, field in ((esdf["state"], esdf["distance"]), (band(esdf), esdf["distance_band"])):
        assert field.shape == state.shape
        taken, rest = np.argwhere(state == 1), np.argwhere(state != 1)
        some = np.random.default_rng(0).permutation(len(rest))[:2000]
        nearest = KDTree(taken).query(rest[some])[0] * esdf["resolution"]
        np.testing.assert_allclose(field[tuple(rest[some].T)], nearest, atol=1e-5)
        assert (field[state == 1] < 0).all()
    points = exported.whole.vertices @ esdf["T_grid_map"][:3, :3].T
    cells = np.floor((points - esdf["origin"]) / esdf["resolution"]).astype(int)
    assert (esdf["state"][tuple(cells.T)] == 1).mean() > 0.99


def test_plan_and_costs_are_those_of_the_grid(exported: Exported) -> None:
    with np.load(exported.folder / "room.npz") as file:
        esdf = dict(file)
    plan, meta = exported.picture("plan.yaml")
    np.testing.assert_array_equal(plan, np.array([205, 254, 0])[band(esdf) + 1])
    assert meta["resolution"] == esdf["resolution"]
    np.testing.assert_allclose(meta["origin"][:2], esdf["origin"][:2], atol=1e-5)
    costs, meta = exported.picture("cost.yaml")
    assert (costs[band(esdf) == 1] == 100).all()
    assert costs[(band(esdf) == 0)].max() < 100
    np.testing.assert_allclose(meta["origin"][:2], esdf["origin"][:2], atol=1e-5)


def band(esdf: dict[str, np.ndarray]) -> np.ndarray:
    """(X, Y): what the height band has of each column."""
    z = esdf["origin"][2] + (np.arange(esdf["state"].shape[2]) + 0.5) * esdf["resolution"] - esdf["floor"]
    low, high = esdf["band"]
    return esdf["state"][:, :, (z >= low) & (z <= high)].max(axis=2)
