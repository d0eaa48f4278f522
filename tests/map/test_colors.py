"""Names of colours."""

from __future__ import annotations

import numpy as np
import pytest

from uppm.map.colors import PROTOTYPES, SYNONYMS, color_name, color_shares, is_colored


@pytest.mark.parametrize(
    ("rgb", "name"),
    [
        ((255, 0, 0), "red"),
        ((150, 20, 25), "red"),
        ((0, 160, 0), "green"),
        ((40, 70, 35), "green"),
        ((0, 0, 255), "blue"),
        ((90, 140, 200), "blue"),
        ((20, 30, 80), "blue"),
        ((255, 220, 0), "yellow"),
        ((255, 140, 0), "orange"),
        ((120, 70, 30), "brown"),
        ((70, 45, 25), "brown"),
        ((210, 190, 160), "beige"),
        ((255, 180, 195), "pink"),
        ((120, 40, 140), "purple"),
        ((60, 190, 180), "turquoise"),
        ((250, 250, 250), "white"),
        ((205, 203, 200), "white"),
        ((125, 125, 125), "gray"),
        ((12, 12, 12), "black"),
        ((45, 44, 42), "black"),
    ],
)
def test_name(rgb: tuple[int, int, int], name: str) -> None:
    shares = color_shares(np.tile(np.array(rgb, dtype=np.uint8), (5, 1)))
    assert shares == {name: 1.0}


def test_an_object_has_the_colours_of_a_good_part_of_it() -> None:
    red, white, blue = (
        np.tile(np.array(c, dtype=np.uint8), (n, 1)) for c, n in (((200, 20, 20), 6), ((250,) * 3, 3), ((0, 0, 255), 1))
    )
    shares = color_shares(np.concatenate([red, white, blue]))
    assert list(shares) == ["red", "white", "blue"]
    assert sum(shares.values()) == pytest.approx(1)
    assert [is_colored(shares, [name]) for name in ("red", "white", "blue")] == [True, False, False]
    assert is_colored(shares, ["white", "red"])
    assert not is_colored(shares, ["red", "blue"])
    assert is_colored({"red": 0.4, "white": 0.35}, ["white"])


def test_a_surface_without_points_has_no_colour() -> None:
    assert color_shares(np.empty((0, 3), dtype=np.uint8)) == {}
    assert not is_colored({}, ["red"])


def test_words() -> None:
    assert color_name("grey") == "gray"
    assert color_name("red") == "red"
    assert color_name("wooden") is None
    assert set(SYNONYMS.values()) <= set(PROTOTYPES)
