"""What questions need of a map beyond its labels: bodies, colours and rooms, each made when first asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from uppm.core.categories import unified_categories
from uppm.core.geometry import invert, transform, upright
from uppm.core.types import Submap, SubmapKind
from uppm.map.boxes import upright_box
from uppm.map.colors import color_shares
from uppm.map.occupancy import FREE, OCCUPIED, NothingThereError, OccupancyGrid, occupancy_grid
from uppm.map.panoptic_map import PanopticMap
from uppm.map.relations import Body
from uppm.map.rooms import Labels, nearest_rooms, room_of, segment_rooms

THINNED, LARGE = 0.02, 0.05
"""Metres to which surfaces are thinned: of objects, and of the background."""
COLORED_POINTS = 2000
"""Vertices of a surface whose colours are looked at, spread over it."""
ROOM_CELL, BAND = 0.05, (0.1, 2.0)
"""Cells of the floor plan, and the heights over the floor that it is of, in metres."""
WALL_HEIGHT = 0.5
"""Metres of wall in that band that make a cell of the plan a wall."""
BARRIERS = ("wall", "window", "door")
"""Beginnings of the names of categories that bound a room; above and around a doorway there is wall as well."""
ROOM_SIGNS: Mapping[str, Mapping[str, float]] = {
    "kitchen": {"refrigerator": 2, "oven": 2, "microwave": 1, "sink": 1, "toaster": 1},
    "bedroom": {"bed": 3, "pillow": 1, "blanket": 1},
    "bathroom": {"toilet": 3, "shower": 3, "bathtub": 3, "hair drier": 1, "toothbrush": 1},
    "office": {"desk-stuff": 2, "laptop": 1, "keyboard": 1, "mouse": 1},
    "living room": {"couch": 2, "tv": 1.5, "remote": 0.5},
    "dining room": {"dining table": 1.5},
}
"""Kind of room -> category -> what one object of it says for that kind."""
NOWHERE = np.zeros((1, 1), dtype=np.int32), np.zeros(2), 0.0
"""A floor plan without rooms."""
ROOM_NAMES = {name: name for name in ROOM_SIGNS} | {"study": "office", "lounge": "living room", "bath": "bathroom"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Room:
    """A part of the floor plan between walls and doorways."""

    id: int
    """From 1, the largest first."""
    area: float
    """Square metres."""
    center: npt.NDArray[np.float64]
    """(3,): middle of its cells, on the floor, frame map, metres; it may lie outside of a room that is no rectangle."""


class Scene:
    """A map's geometry for questions; nothing of it is read before it is needed.

    Parameters
    ----------
    panoptic : the map; its surfaces are those of its meshes, each made once.
    """

    def __init__(self, panoptic: PanopticMap) -> None:
        self._map = panoptic
        self._rotation = np.eye(4)
        self._rotation[:3, :3] = upright(panoptic.up)
        self._cameras = {f.index: f.T_map_camera for f in panoptic.frames if f.T_map_camera is not None}
        self._bodies: dict[int, Body | None] = {}
        self._placed: dict[int, Body | None] = {}
        self._shares: dict[int, dict[str, float]] = {}

    def upright(self, point: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """A point (3,) of frame map in frame upright."""
        return transform(self._rotation, point)

    def body(self, submap: Submap) -> Body | None:
        """Its surface, thinned, its room unknown; None where it has none."""
        if submap.id not in self._bodies:
            self._bodies[submap.id] = self._make_body(submap)
        return self._bodies[submap.id]

    def placed(self, submap: Submap) -> Body | None:
        """Its surface with its room; divides the whole map into rooms at the first call."""
        if submap.id not in self._placed:
            body = self.body(submap)
            self._placed[submap.id] = replace(body, room=self._room(body)) if body else None
        return self._placed[submap.id]

    def shares(self, submap: Submap) -> dict[str, float]:
        """Colour name -> share of its surface."""
        if submap.id not in self._shares:
            colors = self._map.submap_mesh(submap.id).colors
            step = max(1, len(colors) // COLORED_POINTS)
            self._shares[submap.id] = color_shares(colors[::step])
        return self._shares[submap.id]

    def size(self, submap: Submap) -> npt.NDArray[np.float64]:
        """(3,): longer and shorter horizontal side of its upright box, and height; zeros where it has no surface."""
        box = upright_box(self._map.submap_mesh(submap.id).vertices, self._map.up)
        return box.size if box else np.zeros(3)

    def viewpoint(self) -> npt.NDArray[np.float64] | None:
        """(3,): where the last camera stood, frame upright; None for a map without poses."""
        if not self._cameras:
            return None
        return self.upright(self._cameras[max(self._cameras)][:3, 3])

    @property
    def tells_rooms(self) -> bool:
        """Rooms are found in the voxels, which a map of surfaces alone does not have."""
        return self._map.has_voxels

    @cached_property
    def room_names(self) -> dict[int, str]:
        """Room -> what kind it is by the objects in it; rooms without a sign have no name."""
        votes: dict[int, dict[str, float]] = {}
        for submap in self._map.objects:
            body = self.placed(submap)
            if body is None or not body.room or submap.descriptor is None:
                continue
            for name, signs in ROOM_SIGNS.items():
                weight = signs.get(submap.descriptor.category.name, 0)
                if weight:
                    own = votes.setdefault(body.room, {})
                    own[name] = own.get(name, 0.0) + weight
        return {room: max(own, key=lambda name: own[name]) for room, own in votes.items()}

    @cached_property
    def rooms(self) -> tuple[Room, ...]:
        """The rooms that the floor plan is divided into, the largest first; none where the map has no walls to tell."""
        plan, origin, floor = self._rooms
        found = []
        for number in range(1, int(plan.max(initial=0)) + 1):
            cells = np.argwhere(plan == number)
            middle = np.append(origin + (cells.mean(axis=0) + 0.5) * ROOM_CELL, floor)
            center = transform(invert(self._rotation), middle)
            found.append(Room(id=number, area=len(cells) * ROOM_CELL**2, center=center))
        return tuple(found)

    @cached_property
    def _rooms(self) -> tuple[Labels, npt.NDArray[np.float64], float]:
        """The room of each cell, where the plan begins (2,) and the floor's height, frame upright."""
        if not self.tells_rooms:
            return NOWHERE
        try:
            grid = occupancy_grid(self._map, ROOM_CELL)
            inside = floor_plan(grid)
        except NothingThereError:
            return NOWHERE
        return segment_rooms(inside, ROOM_CELL), grid.origin[:2], grid.floor

    @cached_property
    def _nearest(self) -> Labels:
        """The room that each cell is nearest to."""
        return nearest_rooms(self._rooms[0])

    def _room(self, body: Body) -> int:
        return room_of(body.points[:, :2], self._nearest, self._rooms[1], ROOM_CELL)

    def _make_body(self, submap: Submap) -> Body | None:
        mesh = self._map.submap_mesh(submap.id)
        points = mesh.vertices
        if not len(points):
            return None
        cell = THINNED if submap.kind is SubmapKind.OBJECT else LARGE
        _, first = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_index=True)
        camera = self._cameras.get(submap.first_frame)
        name = submap.descriptor.category.name if submap.descriptor else ""
        return Body(
            id=submap.id,
            points=self.upright(points[first].astype(np.float64)),
            normals=mesh.normals[first].astype(np.float64) @ self._rotation[:3, :3].T,
            is_wall=name.startswith("wall"),
            is_barrier=name.startswith(BARRIERS),
            seen_from=None if camera is None else self.upright(camera[:3, 3]),
        )


def floor_plan(grid: OccupancyGrid) -> npt.NDArray[np.bool_]:
    """(X, Y): cells between the walls: seen free or furnished at some height of the band, and no wall."""
    band = grid.layers(*BAND)
    state, category = grid.state[:, :, band], grid.category[:, :, band]
    barrier = (state == OCCUPIED) & np.isin(category, _barriers())
    wall = barrier.sum(axis=2) * grid.resolution >= WALL_HEIGHT
    return ((state == FREE) | (state == OCCUPIED)).any(axis=2) & ~wall


def _barriers() -> list[int]:
    return [category.id for category in unified_categories() if category.name.startswith(BARRIERS)]
