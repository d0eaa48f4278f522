from __future__ import annotations

import numpy as np
import pytest

from tests.evaluation.scenes import grid
from uppm.core.errors import InputError
from uppm.evaluation.checks import check_comparable

SCENE = np.concatenate([grid(0, 0, 0, side=6), grid(0, 0, 2.5, side=6)])


@pytest.mark.parametrize(("factor", "said"), [(1000, "1000 times"), (100, "100 times"), (0.001, "0.001 times")])
def test_units(factor: float, said: str) -> None:
    with pytest.raises(InputError, match=rf"map: expected the scene of truth, .*{said}.*not metres: scale it"):
        check_comparable(1.4 * factor * SCENE, SCENE, "map", "truth")


@pytest.mark.parametrize("scale", [0.01, 0.2, 1.0, 4.0])
def test_parts_of_a_scene_are_no_other_units(scale: float) -> None:
    assert check_comparable(scale * SCENE, SCENE, "map", "truth") is None


def test_elsewhere() -> None:
    with pytest.raises(InputError, match=r"found one from \(20\.00, .* outside .*; align the two frames"):
        check_comparable(SCENE + np.array([20, 0, 0]), SCENE, "map", "truth")


def test_not_finite_and_empty() -> None:
    with pytest.raises(InputError, match="finite vertices, found NaN"):
        check_comparable(np.array([[0, 0, np.nan]]), SCENE, "map", "truth")
    with pytest.raises(InputError, match="found none"):
        check_comparable(np.empty((0, 3)), SCENE, "map", "truth")
