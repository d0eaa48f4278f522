"""Costs of coming near things, by what they are: wide around people and plants, narrow along walls."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from importlib import resources

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from uppm.core.categories import category_by_id, category_by_name
from uppm.core.errors import InputError
from uppm.map.occupancy import FREE, OCCUPIED, OccupancyGrid

TOP, UNKNOWN_COST = 100, 255
"""Cost of an occupied cell, and the mark of an unknown one."""
DEFAULT = "default"


@cache
def inflation_table() -> dict[str, float]:
    """Category or supercategory name, or `default` -> distance in metres at which its cost has fallen to nothing."""
    table = resources.files("uppm.data").joinpath("inflation.csv").read_text(encoding="utf-8")
    return {row["name"]: float(row["metres"]) for row in csv.DictReader(table.splitlines())}


def inflation(category_id: int, own: Mapping[str, float]) -> float:
    """Inflation radius of a category, metres: its own, else its supercategory's, else the default; 0: unlabeled."""
    radii = inflation_table() | dict(own)
    if not category_id:
        return radii[DEFAULT]
    category = category_by_id()[category_id]
    return radii.get(category.name, radii.get(category.supercategory, radii[DEFAULT]))


def semantic_costmap(
    grid: OccupancyGrid, low: float, high: float, own: Mapping[str, float] | None = None
) -> npt.NDArray[np.uint8]:
    """(X, Y) costs of a height band over the floor: 100 where occupied, falling linearly to 0 at the inflation radius
    of the category; the greatest of all categories counts. 255 where unknown and out of all radii.

    own : category or supercategory -> metres, over the table that ships.

    Raises
    ------
    InputError
        `own` names no category, or the band is empty.
    """
    own = dict(own or {})
    known = {*category_by_name(), *(c.supercategory for c in category_by_id().values()), DEFAULT}
    if wrong := sorted(set(own) - known):
        advice = "use a name of `uppm info`, a supercategory, or 'default'"
        raise InputError("inflation", expected="a unified category", found=repr(wrong[0]), advice=advice)
    layers = grid.layers(low, high)
    state, category = grid.state[:, :, layers], grid.category[:, :, layers]
    plan, costs = state.max(axis=2), np.zeros(state.shape[:2])
    for id_ in np.unique(category[state == OCCUPIED]).tolist():
        here = ((state == OCCUPIED) & (category == id_)).any(axis=2)
        distance = np.asarray(distance_transform_edt(~here)) * grid.resolution
        radius = max(inflation(id_, own), grid.resolution)
        costs = np.maximum(costs, TOP * np.clip(1 - distance / radius, 0, 1))
    out = np.rint(costs).astype(np.uint8)
    out[(plan < FREE) & (out == 0)] = UNKNOWN_COST
    return out
