"""NumPy references of the kernels that cast rays, as `reference.py`: a cell and all its rays at a time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from uppm._kernels.reference import Array, dual_crossing

CORNERS = np.array([(c & 1, c >> 1 & 1, c >> 2) for c in range(8)])
"""(8, 3): place of each corner in its cell."""


def surface_cells(
    field: Array, color: Array, belonging: Array, constants: dict[str, float]
) -> dict[tuple[int, ...], tuple[Array, Array, Array]]:
    """Cells of a dense field (X, Y, Z), in voxels, NaN where not observed, that a surface of its own passes through.

    By lowest corner: distances at the corners (8,), which of them are the submap's own (8,), colours (8, 3).
    """
    padded, owns = np.pad(field, 2, constant_values=np.nan), belonging[..., 0] >= np.maximum(belonging[..., 1], 1)
    out: dict[tuple[int, ...], tuple[Array, Array, Array]] = {}
    for cell in np.ndindex(*(n - 1 for n in field.shape)):
        places = np.array(cell) + CORNERS
        known = field[tuple(places.T)]
        if np.nanmin(known, initial=1) >= 0 or np.nanmax(known, initial=-1) < 0:
            continue
        values, own = known.copy(), np.zeros(8, dtype=bool)
        for low, high, at in _crossed(padded, np.array(cell), known, constants):
            for end in (low, high):
                own[end] |= owns[tuple(places[end])]
            if abs(known[low]) + abs(known[high]) > constants["STEEP"]:
                near, far = (low, high) if abs(known[low]) <= abs(known[high]) else (high, low)
                part = at if near == low else 1 - at
                straight = abs(known[near]) * (1 - part) / max(part, constants["ROUNDING"])
                values[far] = np.sign(known[far]) * min(straight, abs(values[far]))
        if own.any() and _continued(values, known):
            out[cell] = values, own, _colors(color[tuple(places.T)], belonging[tuple(places.T)][:, 0] > 0)
    return out


def _crossed(padded: Array, cell: Array, known: Array, constants: dict[str, float]) -> Iterable[tuple[int, int, float]]:
    """Lower and upper corner of each edge that the surface is known to cross, and where."""
    for axis in range(3):
        for low in (c for c in range(8) if not c >> axis & 1):
            high, step = low | 1 << axis, np.eye(3, dtype=int)[axis]
            if (known[low] < 0) != (known[high] < 0):
                at = dual_crossing(padded, cell + 2 + CORNERS[low], step, constants)
                if at is not None:
                    yield low, high, at


def _continued(values: Array, known: Array) -> bool:
    """Fill corners without a distance, from those beside them; False where one has none beside it."""
    cube = known.reshape(2, 2, 2)  # z, y, x
    for c in np.flatnonzero(np.isnan(known)):
        guesses = []
        for axis in range(3):
            rises = np.diff(cube, axis=2 - axis)
            beside = c ^ (1 << axis)
            if not np.isnan(known[beside]) and not np.isnan(rises).all():
                guesses.append(values[beside] + np.nanmean(rises) * (1 if c >> axis & 1 else -1))
        if not guesses:
            return False
        values[c] = np.mean(guesses)
    return True


def _colors(color: Array, seen: Array) -> Array:
    has = seen & color.any(axis=1)
    mean = np.trunc(color[has].astype(np.float32).mean(axis=0)) if has.any() else np.full(3, 128)
    return np.where(has[:, None], color, mean).astype(np.uint8)


def first_hits(corners: Array, cells: Array, origin: Array, directions: Array, limits: Array, steps: int) -> Array:
    """Depth at which each ray (P, 3) passes into the surface of each cell (C, 8), infinite where it does not; (C, P).

    cells (C, 3): lowest corners, as `origin` (3,) in voxels; a ray is at origin + depth * direction.
    """
    out = np.full((len(cells), len(directions)), np.inf)
    for n, (values, cell) in enumerate(zip(corners, cells, strict=True)):
        with np.errstate(divide="ignore"):
            sides = np.stack([cell - origin, cell + 1 - origin])[:, None] / directions
        first = np.maximum(sides.min(axis=0).max(axis=1), limits[0])
        last = np.minimum(sides.max(axis=0).min(axis=1), limits[1])
        inside = np.flatnonzero(first < last)
        first, last, rays, start = first[inside], last[inside], directions[inside], origin - cell
        f, g = (trilinear(values, start + t[:, None] * rays) for t in (first, last))
        entered = (f >= -1e-4) & (g < 0)
        first, last, rays, f, g = first[entered], last[entered], rays[entered], np.maximum(f[entered], 0), g[entered]
        for _ in range(steps):
            t = first + (last - first) * f / (f - g)
            h = trilinear(values, start + t[:, None] * rays)
            first, f = np.where(h >= 0, t, first), np.where(h >= 0, h, f)
            last, g = np.where(h >= 0, last, t), np.where(h >= 0, g, h)
        out[n, inside[entered]] = first + (last - first) * f / (f - g)
    return out


def trilinear(values: Array, places: Array) -> Array:
    """Values (P, ...) at places (P, 3), 0 to 1, of a cell's corners (8, ...)."""
    weights = np.where(CORNERS[None] == 1, places[:, None], 1 - places[:, None]).prod(axis=2)
    return weights @ values
