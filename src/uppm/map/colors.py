"""The colour of an object, by name: its surface's colours against a table of prototypes in CIELAB (docs/query.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from skimage.color import deltaE_ciede2000, rgb2lab

PROTOTYPES: Mapping[str, tuple[tuple[float, float, float], ...]] = MappingProxyType(
    {
        "black": ((5, 0, 0), (16, 0, 2), (22, 1, 3)),
        "gray": ((36, 0, 0), (46, 0, 1), (55, 0, 2), (64, 0, 3)),
        "white": ((77, 0, 2), (87, 0, 2), (97, 0, 1)),
        "red": ((48, 68, 45), (38, 56, 38), (28, 40, 26), (22, 28, 18), (55, 58, 32)),
        "orange": ((62, 48, 58), (70, 32, 62), (56, 48, 45)),
        "brown": ((20, 9, 11), (29, 17, 29), (38, 16, 24), (48, 17, 30), (56, 18, 38), (52, 10, 20)),
        "yellow": ((88, -2, 70), (76, 6, 60), (92, -6, 42), (66, 4, 56)),
        "beige": ((62, 3, 15), (70, 4, 16), (78, 4, 16), (86, 2, 13)),
        "green": ((48, -44, 34), (30, -17, 17), (38, -13, 26), (24, -8, 16), (62, -36, 44), (74, -26, 28)),
        "turquoise": ((68, -36, -6), (50, -28, -8), (80, -28, -4)),
        "blue": ((34, 12, -46), (30, 40, -75), (33, 1, -20), (50, -4, -32), (66, -10, -26), (20, 6, -20)),
        "purple": ((34, 42, -38), (50, 32, -26), (24, 24, -20), (66, 24, -20)),
        "pink": ((72, 34, 4), (82, 20, 4), (60, 54, 2)),
    }
)
"""Colour name -> CIELAB (D65) of what is called so indoors, light and shade included."""
SYNONYMS: Mapping[str, str] = MappingProxyType(
    {
        "grey": "gray",
        "silver": "gray",
        "maroon": "red",
        "burgundy": "red",
        "crimson": "red",
        "gold": "yellow",
        "golden": "yellow",
        "tan": "beige",
        "cream": "beige",
        "navy": "blue",
        "teal": "turquoise",
        "violet": "purple",
    }
)
NEARLY, PART = 0.8, 0.2
"""An object is called by a colour that is so common as the commonest; by several, if each has that part of it."""


def color_shares(colors: npt.NDArray[np.uint8]) -> dict[str, float]:
    """Colour name -> share of the points (N, 3), RGB, that it is nearest to by CIEDE2000; the commonest first."""
    if not len(colors):
        return {}
    lab = rgb2lab(colors.astype(np.float64)[:, None] / 255)
    names = [name for name, places in PROTOTYPES.items() for _ in places]
    table = np.array([place for places in PROTOTYPES.values() for place in places], dtype=np.float64)
    nearest = deltaE_ciede2000(lab, table[None]).argmin(axis=1)
    counts = np.bincount(nearest, minlength=len(names))
    shares = dict.fromkeys(PROTOTYPES, 0.0)
    for name, count in zip(names, counts.tolist(), strict=True):
        shares[name] += count / len(colors)
    return dict(sorted(((n, s) for n, s in shares.items() if s > 0), key=lambda item: -item[1]))


def color_name(word: str) -> str | None:
    """The table's name of a colour word; None for what is no colour."""
    name = SYNONYMS.get(word, word)
    return name if name in PROTOTYPES else None


def is_colored(shares: Mapping[str, float], names: Sequence[str]) -> bool:
    """Whether an object with these shares is called by one colour of the table, or by several at once."""
    least = NEARLY * max(shares.values(), default=1.0) if len(names) == 1 else PART
    return all(shares.get(name, 0.0) >= least for name in names)
