"""USD stages, written and read back by Pixar's library."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.conftest import Uppm
from tests.map.scenes import blocks_of, box, sphere, submap_of
from uppm.core.errors import InputError, MissingExtraError
from uppm.core.types import Mesh
from uppm.export.usd import write_usd
from uppm.map.mesh import empty_mesh, submap_mesh
from uppm.pipeline import open_map

EXTRAS = {"id": 1, "category": "cup", "confidence": 0.75, "labels": {"Größe 2:1": 3}, "center": [0.5, 0.0, 1.0]}


@pytest.fixture(scope="module")
def meshes() -> dict[str, Mesh]:
    shapes = {"1_cup": sphere((0, 0, 0), 0.2), "12_dining table-茶": box((0.3, 0, 0), (0.5, 0.2, 0.2))}
    return {
        name: submap_mesh(submap_of(1), blocks_of(shape, (-0.3,) * 3, (0.7,) * 3, 0.02, seed=1))
        for name, shape in shapes.items()
    }


@pytest.mark.parametrize("ending", [".usda", ".usdc", ".usd"])
@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8)])
def test_round_trip(tmp_path: Path, meshes: dict[str, Mesh], ending: str, up: tuple[float, ...]) -> None:
    usd = pytest.importorskip("pxr.Usd", reason="needs `pip install uppm[usd]`")
    geometry: Any = import_module("pxr.UsdGeom")
    file = tmp_path / f"map{ending}"
    parts = {**meshes, "3_ghost": empty_mesh()}
    write_usd(file, parts, up=np.array(up), extras={"1_cup": {**EXTRAS, "none": None}})
    stage: Any = usd.Stage.Open(str(file))
    assert (geometry.GetStageUpAxis(stage), geometry.GetStageMetersPerUnit(stage)) == ("Z", 1.0)
    root = stage.GetDefaultPrim()
    assert [prim.GetDisplayName() for prim in root.GetChildren()] == list(meshes)
    for prim, expected in zip(root.GetChildren(), meshes.values(), strict=True):
        found = geometry.Mesh(prim)
        np.testing.assert_array_equal(found.GetPointsAttr().Get(), expected.vertices)
        np.testing.assert_array_equal(found.GetNormalsAttr().Get(), expected.normals)
        faces = np.array(found.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        np.testing.assert_array_equal(faces, expected.faces)
        assert found.ValidateTopology(*(attr.Get() for attr in topology(found)), len(expected.vertices))
        linear = np.array(found.GetDisplayColorPrimvar().Get())
        srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        np.testing.assert_allclose(255 * srgb, expected.colors, atol=0.01)
        place = geometry.XformCache().GetLocalToWorldTransform(prim)
        np.testing.assert_allclose(place.TransformDir(tuple(up)), [0, 0, 1], atol=1e-9)
    known = root.GetChildren()[0].GetCustomDataByKey("uppm")
    assert {**known, "center": list(known["center"])} == EXTRAS


def topology(mesh: Any) -> tuple[Any, Any]:
    return mesh.GetFaceVertexIndicesAttr(), mesh.GetFaceVertexCountsAttr()


def test_a_map_is_exported(uppm: Uppm, map_file: Path, tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd", reason="needs `pip install uppm[usd]`")
    done = uppm("export", map_file, "--mesh", tmp_path / "room.usdc")
    assert done.code == 0, done.err
    stage: Any = usd.Stage.Open(str(tmp_path / "room.usdc"))
    found = [prim.GetCustomDataByKey("uppm") for prim in stage.GetDefaultPrim().GetChildren()]
    expected = {s.id: s.descriptor.category.name for s in open_map(map_file).submaps if s.descriptor}
    assert {data["id"]: data["category"] for data in found if "category" in data} == expected


def test_without_the_library_it_says_what_to_install(
    tmp_path: Path, meshes: dict[str, Mesh], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pxr.Gf", None)
    with pytest.raises(MissingExtraError, match=r"usd-core is not installed; run: pip install uppm\[usd\]"):
        write_usd(tmp_path / "a.usda", meshes, up=np.array([0.0, 0.0, 1.0]), extras={})


def test_a_map_of_nothing_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="needs `pip install uppm[usd]`")
    with pytest.raises(InputError, match="expected a map with surfaces"):
        write_usd(tmp_path / "a.usda", {"1_ghost": empty_mesh()}, up=np.array([0.0, 0.0, 1.0]), extras={})
    assert not list(tmp_path.iterdir())
