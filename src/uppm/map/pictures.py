"""The two pictures of a map: a labelled plan from above, and a bird's-eye view."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.types import DynamicDescriptor, Mesh, SubmapKind
from uppm.map.palette import submap_color
from uppm.map.panoptic_map import Coloring, PanopticMap
from uppm.map.render import Image, Picture, choose_view, render, top_view, with_labels

_WALL = (70, 72, 80)


def top_down(panoptic: PanopticMap, *, coloring: Coloring = "color", labels: bool = True, width: int = 1600) -> Image:
    """The map from above, orthographic, objects with their names.

    Ceilings, seen from behind, are left out; walls are drawn where a cut halfway up meets them.

    Returns
    -------
    (H, W, 3) RGB; W as given, H by the map's shape.
    """
    mesh = panoptic.mesh(coloring)
    bounds = _bounds(mesh)
    view = top_view(bounds, panoptic.up)
    across, along = np.abs(view.R_view_map[:2] @ (bounds[1] - bounds[0]))
    height = round(width * float(np.clip(along / max(across, 1e-6), 0.4, 1.2)))
    picture = render(mesh, view, width=width, height=height)
    _draw_walls(picture, panoptic)
    if not labels:
        return picture.image
    return with_labels(picture, _names(panoptic, "category" if coloring == "category" else "instance"))


def birds_eye(panoptic: PanopticMap, *, coloring: Coloring = "color", width: int = 1600, height: int = 1000) -> Image:
    """The map from above at a slant, without its ceiling and near walls; (height, width, 3) RGB."""
    mesh = panoptic.mesh(coloring)
    return render(mesh, choose_view(_bounds(mesh), panoptic.up), width=width, height=height).image


def section(mesh: Mesh, up: npt.NDArray[np.float64], level: float) -> npt.NDArray[np.float64]:
    """Line segments (N, 2, 3) along which a mesh is cut at a height over the origin, metres, frame map."""
    over = mesh.vertices @ up - level
    positive = over[mesh.faces] > 0
    cut = np.flatnonzero(positive.any(axis=1) & ~positive.all(axis=1))
    faces, positive = mesh.faces[cut], positive[cut]
    # The corner that lies on its own side of the cut: both cut edges meet there.
    alone = np.argmax(positive == (positive.sum(axis=1, keepdims=True) == 1), axis=1)
    rows = np.arange(len(faces))
    a = faces[rows, alone]
    ends = []
    for step in (1, 2):
        b = faces[rows, (alone + step) % 3]
        share = (over[a] / (over[a] - over[b]))[:, None]
        ends.append(mesh.vertices[a] + share * (mesh.vertices[b] - mesh.vertices[a]))
    return np.stack(ends, axis=1)


def _draw_walls(picture: Picture, panoptic: PanopticMap) -> None:
    walls = panoptic.mesh(ids=[s.id for s in panoptic.submaps if s.kind is SubmapKind.BACKGROUND])
    if not len(walls.vertices):
        return
    heights = walls.vertices @ panoptic.up
    segments = section(walls, panoptic.up, float(heights.min() + heights.max()) / 2)
    pixels = picture.locate(segments.reshape(-1, 3)).reshape(-1, 2, 2)
    fixed = np.rint(pixels * 16).astype(np.int32)
    thickness = max(2, picture.image.shape[1] // 500)
    cv2.polylines(picture.image, list(fixed), False, _WALL, thickness, cv2.LINE_AA, shift=4)


def _names(
    panoptic: PanopticMap, coloring: Coloring
) -> list[tuple[str, npt.NDArray[np.float64], tuple[int, int, int]]]:
    """Name, place and colour of each object, the largest first: it has most room to give."""
    seen = [s for s in panoptic.objects if s.descriptor and np.isfinite(s.bounds).all()]
    seen.sort(key=lambda s: -float(np.prod(s.extent)))
    return [(_name(s.descriptor), s.center, submap_color(s, coloring)) for s in seen if s.descriptor]


def _name(descriptor: DynamicDescriptor) -> str:
    return descriptor.labels[0].text if descriptor.labels else descriptor.category.name


def _bounds(mesh: Mesh) -> npt.NDArray[np.float64]:
    if not len(mesh.vertices):
        return np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    return np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)]).astype(np.float64)
