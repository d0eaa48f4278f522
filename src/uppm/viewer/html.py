"""A map as one HTML file that needs neither Python nor a network: surfaces, colours, facts and a search over labels."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from importlib import resources
from string import Template
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.core.shown import CHANGE_COLORS, CONFIDENCE_COLORS, Content
from uppm.core.types import Mesh

SCRIPTS = ("math.js", "data.js", "search.js", "scene.js", "controls.js", "panel.js", "main.js")
STEPS = 65535
"""Positions are stored in so many steps of their box: under a millimetre in boxes of up to 60 m."""


def map_page(content: Content, crops: Mapping[int, Sequence[bytes]] | None = None) -> str:
    """The whole document.

    Parameters
    ----------
    crops : mapping, optional
        Submap id -> JPEG files of its best views.

    Raises
    ------
    InputError
        The map has no surface.
    """
    if not content.shown:
        raise InputError(content.title, expected="a map with surfaces", found="none", advice="map more frames")
    header, data = _scene(content, crops or {})
    page = resources.files("uppm.viewer").joinpath("page")
    parts = {
        "title": _escaped(content.title),
        "style": page.joinpath("page.css").read_text(encoding="utf-8"),
        "script": "\n".join(page.joinpath(name).read_text(encoding="utf-8") for name in SCRIPTS),
        # A label is what some network said: it must not end the script element that it stands in.
        "header": json.dumps(header, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c"),
        "data": base64.b64encode(zlib.compress(data, 9)).decode(),
    }
    return Template(page.joinpath("page.html").read_text(encoding="utf-8")).substitute(parts)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")


def _scene(content: Content, crops: Mapping[int, Sequence[bytes]]) -> tuple[dict[str, Any], bytes]:
    """What the page reads as JSON, and the arrays that it describes."""
    packed = [_packed(shown.mesh) for shown in content.shown]
    free_box, free = _quantised(content.free)
    objects = [
        {
            **shown.facts,
            **box,
            "vertices": len(shown.mesh.vertices),
            "triangles": len(shown.mesh.faces),
            "colors": dict(shown.colors),
            "crops": [base64.b64encode(jpeg).decode() for jpeg in crops.get(shown.submap.id, ())],
        }
        for shown, (box, _) in zip(content.shown, packed, strict=True)
    ]
    header = {
        "title": content.title,
        "up": np.round(content.up, 6).tolist(),
        "objects": objects,
        "free": {**free_box, "points": len(free)},
        "path": [[index, *np.round(T[:3].ravel(), 4).tolist()] for index, T in content.path],
        "gone": content.gone,
        "changeColors": dict(CHANGE_COLORS),
        "confidenceColors": CONFIDENCE_COLORS,
    }
    # The widest first, so that each array is aligned.
    columns = [[arrays[name] for _, arrays in packed] for name in ("faces", "vertices", "normals", "colors")]
    columns.insert(2, [free])
    return header, b"".join(array.tobytes() for column in columns for array in column)


def _packed(mesh: Mesh) -> tuple[dict[str, list[float]], dict[str, npt.NDArray[Any]]]:
    """The box of a mesh, and its arrays as they are stored; faces as differences, which compress well."""
    box, vertices = _quantised(mesh.vertices)
    arrays = {
        "faces": np.diff(mesh.faces.ravel(), prepend=0).astype("<i4"),
        "vertices": vertices,
        "normals": np.rint(127 * np.clip(np.nan_to_num(mesh.normals), -1, 1)).astype(np.int8),
        "colors": mesh.colors,
    }
    return box, arrays


def _quantised(points: npt.NDArray[np.float32]) -> tuple[dict[str, list[float]], npt.NDArray[np.uint16]]:
    """Lowest corner and step of the points' box, and the points (N, 3) in steps."""
    if not len(points):
        return {"low": [0.0] * 3, "step": [0.0] * 3}, np.empty((0, 3), dtype="<u2")
    low = points.min(axis=0).astype(np.float64)
    step = np.maximum((points.max(axis=0) - low) / STEPS, 1e-9)
    box = {"low": low.tolist(), "step": step.tolist()}
    return box, np.rint((points - low) / step).astype("<u2")
