"""Rooms: the floor plan, divided where it narrows to a doorway (docs/query.md)."""

from __future__ import annotations

from typing import cast

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt, gaussian_filter, label
from skimage.feature import peak_local_max
from skimage.morphology import area_closing
from skimage.segmentation import watershed

Plan = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]

DOORWAY = 1.4
"""Metres: two regions that meet over a wider line are one room."""
NARROWING = 0.8
"""So much narrower than both regions must the line be on which they meet: a corridor has doors too."""
MIN_ROOM = 1.0
"""Square metres."""
SMOOTH = 0.1
"""Metres, standard deviation: what a ragged wall does to distances."""
MAX_HOLE = 0.05
"""Square metres: smaller holes are gaps in what was seen; a piece of wall that stands alone is larger."""


def segment_rooms(inside: Plan, resolution: float) -> Labels:
    """Room of each cell (X, Y) of a floor plan, from 1, the largest first; 0 where there is none.

    A watershed of the distance to the nearest cell outside finds regions; neighbours are joined, the widest passage
    first, unless it is a doorway: narrower than `DOORWAY` and than `NARROWING` of either region.

    Parameters
    ----------
    inside : (X, Y)
        Cells between the walls, furniture included.
    resolution : float
        Side of a cell, metres.
    """
    inside = area_closing(np.pad(inside, 1).astype(np.uint8), round(MAX_HOLE / resolution**2))[1:-1, 1:-1] > 0
    distance = np.asarray(distance_transform_edt(np.pad(inside, 1)))[1:-1, 1:-1] * resolution
    distance = np.where(inside, gaussian_filter(distance, SMOOTH / resolution), 0)
    peaks = peak_local_max(distance, min_distance=max(1, round(2 * SMOOTH / resolution)))
    markers = np.zeros(inside.shape, dtype=np.int32)
    markers[tuple(peaks.T)] = np.arange(1, len(peaks) + 1)
    regions = np.asarray(watershed(-distance, markers, mask=inside), dtype=np.int32)
    return _largest_first(_joined(regions, distance), resolution)


def _joined(regions: Labels, distance: npt.NDArray[np.float64]) -> Labels:
    """Regions joined over every passage that is no doorway."""
    count = int(regions.max(initial=0))
    widest = np.zeros(count + 1)
    np.maximum.at(widest, regions.ravel(), distance.ravel())
    parent = list(range(count + 1))

    def root(region: int) -> int:
        while parent[region] != region:
            region = parent[region]
        return region

    for half_width, a, b in _passages(regions, distance):
        a, b = root(a), root(b)
        doorway = 2 * half_width < DOORWAY and half_width < NARROWING * min(widest[a], widest[b])
        if a != b and not doorway:
            parent[b] = a
            widest[a] = max(widest[a], widest[b])
    return np.array([root(region) for region in range(count + 1)], dtype=np.int32)[regions]


def _passages(regions: Labels, distance: npt.NDArray[np.float64]) -> list[tuple[float, int, int]]:
    """(half the width in metres, region, region) of the widest place at which two regions meet, the widest first."""
    met: dict[tuple[int, int], float] = {}
    for axis in (0, 1):
        r, d = np.moveaxis(regions, axis, 0), np.moveaxis(distance, axis, 0)
        border = (r[1:] != r[:-1]) & (r[1:] > 0) & (r[:-1] > 0)
        pairs = np.sort(np.stack([r[1:][border], r[:-1][border]], axis=1), axis=1)
        widths = np.minimum(d[1:], d[:-1])[border]
        for (a, b), width in zip(pairs.tolist(), widths.tolist(), strict=True):
            met[a, b] = max(met.get((a, b), 0.0), width)
    return sorted(((width, a, b) for (a, b), width in met.items()), reverse=True)


def _largest_first(regions: Labels, resolution: float) -> Labels:
    """Renumbered by area; connected parts are rooms of their own, and those under `MIN_ROOM` none."""
    parts = np.zeros_like(regions)
    for region in np.unique(regions[regions > 0]):
        own = cast("tuple[Labels, int]", label(regions == region))[0]
        parts[own > 0] = own[own > 0] + parts.max()
    area = np.bincount(parts.ravel())
    area[0] = 0
    kept = [part for part in np.argsort(-area, kind="stable") if area[part] * resolution**2 >= MIN_ROOM]
    number = np.zeros(len(area), dtype=np.int32)
    number[kept] = np.arange(1, len(kept) + 1)
    return number[parts]


def nearest_rooms(rooms: Labels) -> Labels:
    """The rooms (X, Y) with every other cell given to the room that is nearest to it."""
    if not rooms.any():
        return rooms
    indices = np.asarray(distance_transform_edt(rooms == 0, return_distances=False, return_indices=True))
    return rooms[tuple(indices)]


def room_of(points: npt.NDArray[np.float64], rooms: Labels, origin: npt.NDArray[np.float64], resolution: float) -> int:
    """The room that most of the points (N, 2) are in; 0 where that is none.

    Parameters
    ----------
    rooms : (X, Y)
        Of `nearest_rooms`, so that what hangs on a wall has a room too; points outside count at the border.
    origin : (2,)
        Lowest corner of cell (0, 0), metres.
    """
    cells = np.floor((points - origin) / resolution).astype(int)
    cells = np.clip(cells, 0, np.array(rooms.shape) - 1)
    return int(np.bincount(rooms[tuple(cells.T)]).argmax())
