"""Pictures of a mesh without a display: a plan from above and a bird's-eye view, shaded and antialiased."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from uppm._kernels import raster
from uppm.core.types import Mesh

Image = npt.NDArray[np.uint8]
Vector = Sequence[float] | npt.NDArray[np.floating]

BACKGROUND = (236, 238, 242)
Z_UP = (0.0, 0.0, 1.0)
_SUPERSAMPLING = 2
_MARGIN = 0.04
"""Share of the picture left free on each side."""
_OUTLIERS = 0.0005
"""Share of the vertices, at each side, that may fall out of the picture."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A direction to look in; the distance follows from what is to fit into the picture."""

    R_view_map: npt.NDArray[np.float64]
    """(3, 3); axes of the view: x right, y down, z forward."""
    field_of_view: float | None = None
    """Horizontal, radians; None: orthographic."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """An image, and where points of the map are on it."""

    image: Image
    """(H, W, 3), RGB."""
    projection: _Projection

    def locate(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Pixel coordinates (N, 2) of points (N, 3) in frame map."""
        return (self.projection.screen(points)[:, :2] + 0.5) / _SUPERSAMPLING - 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class _Projection:
    R_view_map: npt.NDArray[np.float64]
    eye: npt.NDArray[np.float64]
    """(3,) frame view; of an orthographic view, the point at the picture's centre."""
    scale: float
    """Pixels a metre (orthographic), or the focal length in pixels."""
    center: tuple[float, float]
    perspective: bool

    def screen(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """(V, 3): pixel coordinates and nearness."""
        p = points @ self.R_view_map.T - self.eye
        near = 1 / np.maximum(p[:, 2], 1e-6) if self.perspective else -p[:, 2]
        scale = self.scale * (near if self.perspective else np.ones_like(near))
        return np.stack([self.center[0] + scale * p[:, 0], self.center[1] + scale * p[:, 1], near], axis=1)


def look_along(direction: Vector, up: Vector = Z_UP, field_of_view: float | None = None) -> View:
    """A view along a direction, frame map; `up` points upwards in the picture."""
    forward = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return View(R_view_map=np.stack([right, np.cross(forward, right), forward]), field_of_view=field_of_view)


def top_view(bounds: npt.NDArray[np.floating], up: Vector = Z_UP) -> View:
    """Straight down, orthographic, the longer side of the bounds (2, 3) across the picture."""
    across, _ = _horizontal_axes(bounds, up)
    down = -np.asarray(up, dtype=np.float64)
    return look_along(down, np.cross(across, down))


def choose_view(bounds: npt.NDArray[np.floating], up: Vector = Z_UP) -> View:
    """From above at a slant, a little from the side, perspective: with faces seen from behind left out, near walls and
    ceiling are cut away as in a doll's house."""
    across, along = _horizontal_axes(bounds, up)
    direction = 0.62 * along + 0.16 * across - np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    return look_along(direction, up, field_of_view=np.deg2rad(38))


def render(
    mesh: Mesh, view: View, *, width: int = 1600, height: int = 1000, fit: npt.NDArray[np.floating] | None = None
) -> Picture:
    """The mesh seen along a view; faces seen from behind are not drawn.

    Parameters
    ----------
    fit : (N, 3), frame map, what is to fit into the picture; None: the mesh.
    """
    w, h = width * _SUPERSAMPLING, height * _SUPERSAMPLING
    projection = _fitted((mesh.vertices if fit is None else fit).astype(np.float64), view, w, h)
    screen = projection.screen(mesh.vertices.astype(np.float64))
    values = np.concatenate([mesh.colors.astype(np.float32), mesh.normals], axis=1)
    face, nearness, pixels = raster.rasterize(screen, mesh.faces, values, h, w)
    light = _light(pixels[..., 3:], view) * _occlusion(face, nearness, projection)
    image = np.where(face[..., None] >= 0, pixels[..., :3] * light[..., None], np.array(BACKGROUND, np.float32))
    image = cv2.resize(np.clip(image, 0, 255), (width, height), interpolation=cv2.INTER_AREA)
    return Picture(image=np.rint(image).astype(np.uint8), projection=projection)


def with_labels(picture: Picture, labels: Sequence[tuple[str, Vector, tuple[int, int, int]]]) -> Image:
    """The picture with names: text, place in frame map (3,) and colour each; moved apart where they would overlap."""
    image, taken = picture.image.copy(), []
    scale = picture.image.shape[1] / 2400
    for text, place, color in labels:
        u, v = picture.locate(np.asarray(place, dtype=np.float64)[None])[0]
        (w, h), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
        size = np.array([w + h, 2 * h + below])
        corner = _free_place(np.array([u, v]) - size / 2, size, taken, picture.image.shape)
        taken.append((corner, size))
        _draw_label(image, text, (u, v), corner, size, (h, scale), color)
    return image


def _horizontal_axes(
    bounds: npt.NDArray[np.floating], up: Vector
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Unit vectors (3,) of the longer and the shorter horizontal side of the bounds."""
    vertical = int(np.argmax(np.abs(up)))
    extent = np.asarray(bounds[1] - bounds[0], dtype=np.float64)
    first, second = (i for i in np.argsort(-extent) if i != vertical)
    normal = np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    across = np.eye(3)[first] - normal * normal[first]
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    return across, along * np.sign(along[second] or 1.0)


def _fitted(vertices: npt.NDArray[np.float64], view: View, width: int, height: int) -> _Projection:
    """Place the eye so that the vertices just fill the picture less its margin."""
    half = np.array([width, height]) * (0.5 - _MARGIN)
    center = ((width - 1) / 2, (height - 1) / 2)
    p = (vertices if len(vertices) else np.zeros((1, 3))) @ view.R_view_map.T
    if view.field_of_view is None:
        low, high = _spread(p[:, :2])
        scale = float((half * 2 / np.maximum(high - low, 1e-3)).min())
        eye = np.array([*(low + high) / 2, 0.0])
        return _Projection(R_view_map=view.R_view_map, eye=eye, scale=scale, center=center, perspective=False)
    focal = 0.5 * width / np.tan(view.field_of_view / 2)
    # A point is inside where |p_x - e_x| <= t (p_z - e_z): two planes a side, of which the tightest count.
    t = half / focal
    inner, _ = _spread(p[:, :2] + t * p[:, 2:])
    _, outer = _spread(p[:, :2] - t * p[:, 2:])
    eye = np.array([*(inner + outer) / 2, ((inner - outer) / (2 * t)).min()])
    return _Projection(R_view_map=view.R_view_map, eye=eye, scale=float(focal), center=center, perspective=True)


def _spread(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.quantile(values, [_OUTLIERS, 1 - _OUTLIERS], axis=0)


def _light(normals: npt.NDArray[np.float32], view: View) -> npt.NDArray[np.float32]:
    """Ambient light and a key light over the viewer's left shoulder, (H, W)."""
    to_light = np.array([-0.45, -0.65, -0.75]) @ view.R_view_map
    to_light = (to_light / np.linalg.norm(to_light)).astype(np.float32)
    return (0.62 + 0.42 * np.maximum(normals @ to_light, 0)).astype(np.float32)


def _occlusion(
    face: npt.NDArray[np.int32], nearness: npt.NDArray[np.float64], projection: _Projection
) -> npt.NDArray[np.float32]:
    """Darkens what lies behind its surroundings on the screen, (H, W): corners, and the outline of things."""
    there = face >= 0
    safe = np.where(there, nearness, 1.0)
    depth = (1 / safe if projection.perspective else -safe).astype(np.float32)
    weight = there.astype(np.float32)
    shade = np.ones(face.shape, np.float32)
    for radius, strength in ((0.004, 1.6), (0.02, 0.5)):
        size = 2 * round(radius * face.shape[1] / 2) + 1
        total = cv2.blur(weight, (size, size))
        around = cv2.blur(np.where(there, depth, 0).astype(np.float32), (size, size)) / np.maximum(total, 1e-6)
        behind = np.clip(depth - around, 0, 0.25)
        shade *= np.exp(-strength * behind)
    return shade


def _free_place(
    corner: npt.NDArray[np.float64],
    size: npt.NDArray[np.int64],
    taken: Sequence[tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]],
    shape: tuple[int, ...],
) -> npt.NDArray[np.float64]:
    """The place nearest to `corner`, on growing rings, where a label of a size (2,) covers no other."""
    limit = np.array([shape[1], shape[0]]) - size
    for step in range(200):
        ring, angle = 0.35 * size[1] * (step / 8), 2.4 * step
        place = np.clip(corner + ring * np.array([np.cos(angle), np.sin(angle)]), 0, np.maximum(limit, 0))
        if all((place + size <= other).any() or (other + extent <= place).any() for other, extent in taken):
            return place
    return np.clip(corner, 0, np.maximum(limit, 0))


def _draw_label(
    image: Image,
    text: str,
    place: tuple[float, float],
    corner: npt.NDArray[np.float64],
    size: npt.NDArray[np.int64],
    font: tuple[int, float],
    color: tuple[int, int, int],
) -> None:
    """A filled box in the label's colour with a line to the place that it names."""
    x, y = np.rint(corner).astype(int).tolist()
    w, h = size.tolist()
    line, scale = font
    middle = (x + w // 2, y + h // 2)
    cv2.line(image, (round(place[0]), round(place[1])), middle, (40, 40, 40), 1, cv2.LINE_AA)
    fill = tuple(round(0.35 * c + 0.65 * 255) for c in color)
    cv2.rectangle(image, (x, y), (x + w, y + h), fill, cv2.FILLED)
    cv2.rectangle(image, (x, y), (x + w, y + h), color, 1, cv2.LINE_AA)
    cv2.putText(
        image,
        text,
        (x + line // 2, y + line // 2 + line),
        cv2.FONT_HERSHEY_SIMPLEX,
        scale,
        (20, 20, 20),
        1,
        cv2.LINE_AA,
    )
