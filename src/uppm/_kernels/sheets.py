"""Tables of dual marching cubes: which crossed edges of a cell are of one sheet of surface, by its corners' signs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt


def _corner(axis: int, b: int, c: int, end: int) -> int:
    """Corner at an end of edge 4 * axis + 2 * b + c; bit a of a corner: it is the upper one along axis a."""
    return end << axis | b << (axis + 1) % 3 | c << (axis + 2) % 3


_CORNERS = [[_corner(axis, b, c, end) for end in (0, 1)] for axis in range(3) for b in (0, 1) for c in (0, 1)]
_FACES = [
    [e for e, ends in enumerate(_CORNERS) if all(corner >> axis & 1 == side for corner in ends)]
    for axis in range(3)
    for side in (0, 1)
]


def _crossed(case: int, edges: Iterable[int]) -> list[int]:
    return [e for e in edges if case >> _CORNERS[e][0] & 1 != case >> _CORNERS[e][1] & 1]


def _joined(case: int, face: list[int]) -> list[tuple[int, int]]:
    """Pairs of crossed edges of a cell's face that the surface joins.

    Of four, those around an inside corner: the cells on both sides of the face see the same pairs.
    """
    crossed = _crossed(case, face)
    if len(crossed) == 2:
        return [(crossed[0], crossed[1])]
    pairs = [(e, f, set(_CORNERS[e]) & set(_CORNERS[f])) for e in crossed for f in crossed if e < f]
    return [(e, f) for e, f, shared in pairs if any(case >> corner & 1 for corner in shared)]


def _sheets() -> tuple[npt.NDArray[np.int8], npt.NDArray[np.int8]]:
    count, sheet = np.zeros(256, dtype=np.int8), np.full((256, 12), -1, dtype=np.int8)
    for case in range(256):
        group = {e: e for e in _crossed(case, range(12))}
        for e, f in (pair for face in _FACES for pair in _joined(case, face)):
            group = {k: group[e] if g == group[f] else g for k, g in group.items()}
        names = sorted(set(group.values()))
        count[case] = len(names)
        for e, name in group.items():
            sheet[case, e] = names.index(name)
    return count, sheet


EDGES = np.array(_CORNERS, dtype=np.int8)
"""(12, 2): lower and upper corner of edge 4 * axis + 2 * b + c, which lies at b, c along the next two axes."""
SHEETS, SHEET = _sheets()
"""(256,): number of sheets of each case (bit k: corner k is inside); (256, 12): sheet of each edge, or -1."""
BITS = np.array([bin(n).count("1") for n in range(16)], dtype=np.int8)
"""Number of bits set."""
