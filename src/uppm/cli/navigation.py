"""The grids of `uppm export`: plan, costs and distances."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from uppm.core.errors import InputError

if TYPE_CHECKING:
    from uppm.map.panoptic_map import PanopticMap


def write_grids(
    panoptic: PanopticMap,
    occupancy: Path | None,
    costmap: Path | None,
    esdf: Path | None,
    resolution: float,
    band: tuple[float, float],
    inflation: Sequence[str],
) -> list[Path]:
    """Write those that were asked for, of one occupancy grid; returns the files."""
    if not (occupancy or costmap or esdf):
        return []
    from uppm.export.grids import write_arrays, write_costs, write_plan
    from uppm.map.costmap import semantic_costmap
    from uppm.map.occupancy import distance_field, occupancy_grid

    own = _radii(inflation)
    grid = occupancy_grid(panoptic, resolution)
    plan, corner = grid.plan(*band), (float(grid.origin[0]), float(grid.origin[1]))
    written = []
    if occupancy:
        written += write_plan(occupancy, plan, resolution=resolution, origin=corner)
    if costmap:
        costs = semantic_costmap(grid, *band, own)
        written += write_costs(costmap, costs, resolution=resolution, origin=corner)
    if esdf:
        arrays = {
            "distance": distance_field(grid.state, resolution),
            "distance_band": distance_field(plan, resolution),
            "state": grid.state,
            "category": grid.category,
            "origin": grid.origin,
            "resolution": resolution,
            "floor": grid.floor,
            "band": band,
            "T_grid_map": grid.T_grid_map,
        }
        write_arrays(esdf, arrays)
        written.append(esdf)
    return written


def _radii(texts: Sequence[str]) -> dict[str, float]:
    radii = {}
    for text in texts:
        name, _, metres = text.partition("=")
        try:
            radii[name.strip()] = float(metres)
            valid = 0 <= radii[name.strip()] < float("inf")
        except ValueError:
            valid = False
        if not valid:
            advice = "write it so, as --inflation chair=0.5"
            raise InputError("--inflation", expected="NAME=METRES", found=repr(text), advice=advice)
    return radii
