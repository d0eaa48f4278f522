"""A map's surfaces, freespace and camera path as nodes of viser's scene, of which only what changed is sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from uppm.core.shown import CHANGE_COLORS, Content, Shown
from uppm.core.types import Mesh
from uppm.viewer.facts import gone_name
from uppm.viewer.look import Look, Style, style_of

FREE_COLOR = (50, 140, 215)
PATH_COLOR = (25, 25, 150)
FRUSTUM = np.array([[-0.16, -0.12, 0.24], [0.16, -0.12, 0.24], [0.16, 0.12, 0.24], [-0.16, 0.12, 0.24]])
"""Corners of a drawn camera's image, metres, frame camera."""
MARK = 0.06
"""Radius of a ball where something was, metres."""
FRUSTUMS = 40
"""Cameras drawn along the path, at most about so many."""

# glTF's vertex colours are linear light; a map's are sRGB, as cameras give them.
_LEVELS = np.arange(256) / 255
_LINEAR = np.rint(255 * np.where(_LEVELS < 0.04045, _LEVELS / 12.92, ((_LEVELS + 0.055) / 1.055) ** 2.4)).astype(
    np.uint8
)

Clicked = Callable[[int, Any], None]
"""Submap id, viser's event."""


class SubmapNode:
    """One submap: its surface in its own colours, and in one colour, each sent when it is first needed."""

    def __init__(self, scene: Any, shown: Shown, clicked: Clicked) -> None:
        self.shown = shown
        """As it is now; a surface that stays the same is not sent again."""
        self._scene, self._clicked = scene, clicked
        self._sent: dict[bool, tuple[Any, Mesh]] = {}
        """Textured or not -> its node and the surface that it has."""

    def apply(self, style: Style) -> None:
        """Show it so."""
        for textured in (True, False):
            wanted = style.visible and style.textured == textured
            handle, mesh = self._sent.get(textured, (None, None))
            if mesh is not self.shown.mesh:
                if wanted:
                    handle = self._add(textured)  # takes the place of an older one, without a gap
                elif handle is not None:
                    handle.remove()
                    del self._sent[textured]
                    continue
            if handle is not None:
                look = {} if textured else {"color": style.color, "opacity": style.opacity}
                _set(handle, visible=wanted, **(look if wanted else {}))

    def remove(self) -> None:
        """Take it out of the scene."""
        for handle, _ in self._sent.values():
            handle.remove()
        self._sent.clear()

    def _add(self, textured: bool) -> Any:
        id_, mesh = self.shown.submap.id, self.shown.mesh
        name = f"/map/{id_}/{'textured' if textured else 'flat'}"
        if textured:
            handle = self._scene.add_glb(name, _glb(mesh), cast_shadow=False)
        else:
            handle = self._scene.add_mesh_simple(name, mesh.vertices, mesh.faces, side="front", cast_shadow=False)
        self._sent[textured] = handle, mesh

        @handle.on_click
        def _(event: Any) -> None:
            self._clicked(id_, event)

        return handle


class MapNodes:
    """All nodes of a map."""

    def __init__(self, scene: Any, clicked: Clicked) -> None:
        self._scene, self._clicked = scene, clicked
        self._submaps: dict[int, SubmapNode] = {}
        self._path: tuple[tuple[int, npt.NDArray[np.float64]], ...] = ()
        self._free: Any = None
        self._gone: list[Any] = []
        """Marks of what an older map had and this one lacks."""
        self._lines: Any = None

    @property
    def shown(self) -> dict[int, Shown]:
        """What there is, by submap id."""
        return {id_: node.shown for id_, node in self._submaps.items()}

    def update(self, content: Content, look: Look) -> None:
        """Take over a newer map."""
        now = {shown.submap.id: shown for shown in content.shown}
        for id_ in self._submaps.keys() - now.keys():
            self._submaps.pop(id_).remove()
        for id_, shown in now.items():
            if id_ in self._submaps:
                self._submaps[id_].shown = shown
            else:
                self._submaps[id_] = SubmapNode(self._scene, shown, self._clicked)
        self._path = content.path
        if len(content.free):
            colors = np.tile(np.array(FREE_COLOR, dtype=np.uint8), (len(content.free), 1))
            self._free = self._scene.add_point_cloud("/free", content.free, colors, point_size=0.03, visible=look.free)
        self._mark_gone(content)
        self.restyle(look)

    def restyle(self, look: Look) -> None:
        """Show everything as chosen."""
        for node in self._submaps.values():
            node.apply(style_of(node.shown, look))
        if self._free is not None:
            _set(self._free, visible=look.free)
        for mark in self._gone:
            _set(mark, visible=look.coloring == "change")
        self._draw_path(look)

    def _mark_gone(self, content: Content) -> None:
        """A ball and its name where each object of an older map was that this one lacks."""
        for mark in self._gone:
            mark.remove()
        self._gone = []
        for change in content.gone:
            name, at = f"/gone/{change['id_old']}", change["center_old"]
            color = CHANGE_COLORS[change["state"]]
            ball = self._scene.add_icosphere(f"{name}/ball", MARK, color, position=at, visible=False, cast_shadow=False)
            label = self._scene.add_label(f"{name}/name", gone_name(change), position=at, visible=False)
            self._gone += [ball, label]

    def _draw_path(self, look: Look) -> None:
        poses = [T for index, T in self._path if look.until is None or index <= look.until]
        if look.path and len(poses) > 1:
            # Under one name: the newer lines replace the older ones.
            self._lines = self._scene.add_line_segments("/path", path_lines(poses), PATH_COLOR, thickness=0.012)
        elif self._lines is not None:
            self._lines.remove()
            self._lines = None


def path_lines(poses: list[npt.NDArray[np.float64]]) -> npt.NDArray[np.float32]:
    """Segments (N, 2, 3) from camera to camera, and pyramids at some of them and the last."""
    at = np.stack([T[:3, 3] for T in poses])
    lines = [np.stack([at[:-1], at[1:]], axis=1)]
    step = max(1, len(poses) // FRUSTUMS)
    for T in [*poses[::step], poses[-1]]:
        corners = FRUSTUM @ T[:3, :3].T + T[:3, 3]
        eye = np.broadcast_to(T[:3, 3], corners.shape)
        lines += [np.stack([eye, corners], axis=1), np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)]
    return np.concatenate(lines).astype(np.float32)


def _glb(mesh: Mesh) -> bytes:
    """A mesh with its colours and normals as a binary glTF."""
    part = trimesh.Trimesh(
        vertices=mesh.vertices,
        faces=mesh.faces,
        vertex_normals=mesh.normals,
        vertex_colors=_LINEAR[mesh.colors],
        process=False,
        validate=False,
    )
    data = part.export(file_type="glb", include_normals=True)
    assert isinstance(data, bytes)
    return data


def _set(handle: Any, **values: Any) -> None:
    """Assign what differs: each assignment is a message to every browser."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)
