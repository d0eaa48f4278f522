"""Meshes as a USD stage (extra `usd`): a prim a submap, with what is known of it as custom data."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError, MissingExtraError
from uppm.core.geometry import upright
from uppm.core.types import Mesh
from uppm.export.colors import linear_light
from uppm.export.files import write_bytes

FORMATS = (".usd", ".usda", ".usdc")
ROOT, DATA = "/Map", "uppm"


def write_usd(
    path: Path | str,
    meshes: Mapping[str, Mesh],
    *,
    up: npt.NDArray[np.float64],
    extras: Mapping[str, Mapping[str, Any]],
) -> None:
    """Named meshes as children of `/Map`, metres, up +z: `.usda` is text, the others are binary.

    Points are in frame map; `/Map` turns its `up` (3,) to +z. Display colours are linear, as USD has them. A prim's
    display name is the mesh's; its `extras` are custom data under `uppm`, without what is None.

    Raises
    ------
    InputError
        There is no triangle at all, or the file cannot be written.
    MissingExtraError
        `usd-core` is not installed.
    """
    pxr, path = _library(), Path(path)
    shown = {name: mesh for name, mesh in meshes.items() if len(mesh.faces)}
    if not shown:
        raise InputError(path, expected="a map with surfaces", found="none", advice="map more frames, then export")
    stage = pxr.Usd.Stage.CreateInMemory()
    pxr.UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    pxr.UsdGeom.SetStageUpAxis(stage, pxr.UsdGeom.Tokens.z)
    root = pxr.UsdGeom.Xform.Define(stage, ROOT)
    turn = np.eye(4)
    turn[:3, :3] = upright(up)
    root.AddTransformOp().Set(pxr.Gf.Matrix4d(*turn.T.ravel().tolist()))  # USD's matrices act on rows.
    stage.SetDefaultPrim(root.GetPrim())
    for name, mesh in shown.items():
        _define(pxr, stage, name, mesh, extras.get(name, {}))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"map{path.suffix.lower()}"
        stage.GetRootLayer().Export(str(file))
        write_bytes(path, file.read_bytes())


def _library() -> Any:
    """The modules of `pxr` that are used here; it tells no type checker what is in them."""
    try:
        return SimpleNamespace(**{name: import_module(f"pxr.{name}") for name in ("Gf", "Tf", "Usd", "UsdGeom", "Vt")})
    except ImportError:
        raise MissingExtraError("usd-core", "pip install uppm[usd]") from None


def _define(pxr: Any, stage: Any, name: str, mesh: Mesh, extras: Mapping[str, Any]) -> None:
    # An identifier begins with a letter; the id that the name begins with keeps it apart from the others.
    prim = pxr.UsdGeom.Mesh.Define(stage, f"{ROOT}/{pxr.Tf.MakeValidIdentifier(f'Submap_{name}')}")
    prim.CreateSubdivisionSchemeAttr(pxr.UsdGeom.Tokens.none)
    prim.CreatePointsAttr(pxr.Vt.Vec3fArray.FromNumpy(mesh.vertices))
    prim.CreateExtentAttr(pxr.Vt.Vec3fArray.FromNumpy(np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])))
    prim.CreateFaceVertexIndicesAttr(pxr.Vt.IntArray.FromNumpy(mesh.faces.ravel()))
    prim.CreateFaceVertexCountsAttr(pxr.Vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, dtype=np.int32)))
    prim.CreateNormalsAttr(pxr.Vt.Vec3fArray.FromNumpy(mesh.normals))
    prim.SetNormalsInterpolation(pxr.UsdGeom.Tokens.vertex)
    color = prim.CreateDisplayColorPrimvar(pxr.UsdGeom.Tokens.vertex)
    color.Set(pxr.Vt.Vec3fArray.FromNumpy(linear_light(mesh.colors)))
    prim.GetPrim().SetDisplayName(name)
    prim.GetPrim().SetCustomDataByKey(DATA, _plain(pxr, extras))


def _plain(pxr: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """What a USD dictionary can hold."""
    out = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            out[key] = _plain(pxr, value)
        elif isinstance(value, list):
            out[key] = pxr.Vt.DoubleArray(value)
        elif value is not None:
            out[key] = value
    return out
