"""The structured-light model: its statistics, its shadows, and that frames can be read in any order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.cli.room import write_room
from uppm.core.config import Config, InputConfig
from uppm.datasets.noise import AXIAL, BASELINE, in_shadow, structured_light
from uppm.datasets.registry import open_sequence

FX = 320.0
SHAPE = (240, 320)


def facing(z: float) -> np.ndarray:
    return np.full(SHAPE, z, dtype=np.float32)


@pytest.mark.parametrize("z", [0.5, 1.0, 2.0, 4.0])
def test_noise_grows_with_the_square_of_the_depth_and_has_no_bias(z: float) -> None:
    error = structured_light(facing(z), FX, 0, 0) - z
    sigma = AXIAL * z**2
    np.testing.assert_allclose(error.std(), sigma, rtol=0.02)
    assert abs(error.mean()) < 4 * sigma / np.sqrt(error.size)
    # Normal, and pixels are independent.
    np.testing.assert_allclose((np.abs(error) < sigma).mean(), 0.683, atol=0.01)
    for step in (error[:, 1:] * error[:, :-1], error[1:] * error[:-1]):
        assert abs(step.mean()) < 0.02 * sigma**2


def test_holes_stay_holes_and_a_facing_wall_has_none() -> None:
    depth = facing(2.0)
    assert (structured_light(depth, FX, 0, 0) > 0).all()
    depth[:, 100:140] = 0
    noisy = structured_light(depth, FX, 0, 0)
    assert (noisy[:, 104:136] == 0).all()
    assert (noisy[:, :96] > 0).all()


@pytest.mark.parametrize(("near", "far"), [(1.0, 2.0), (0.8, 3.0)])
def test_a_step_casts_a_shadow_of_the_difference_of_disparities(near: float, far: float) -> None:
    depth = facing(far)
    depth[:, 150:200] = near
    shadow = in_shadow(depth, FX)
    width = FX * BASELINE * (1 / near - 1 / far)
    assert abs(shadow[0].sum() - width) <= 1
    # On the left of what is near, all of it, and nowhere else.
    assert shadow[0, 150 - int(width) + 1 : 150].all()
    assert not shadow[0, 150:].any()
    # Beside the shadow, neighbouring pixels mix over the step.
    noisy = structured_light(depth, FX, 0, 0)
    assert (noisy[:, 199] > (near + far) / 2).mean() > 0.02
    assert (noisy[:, 195] > (near + far) / 2).mean() == 0
    assert 0.9 < (noisy[:, 150 - int(width) // 2] == 0).mean() <= 1


def test_a_slanted_wall_is_lit() -> None:
    depth = np.tile(np.linspace(1.0, 3.0, SHAPE[1], dtype=np.float32), (SHAPE[0], 1))
    for wall in (depth, depth[:, ::-1].copy()):
        assert not in_shadow(np.round(wall, 3), FX).any()


def test_seed_and_frame_decide() -> None:
    depth = facing(2.0)
    first = structured_light(depth, FX, 0, 7)
    np.testing.assert_array_equal(first, structured_light(depth, FX, 0, 7))
    for other in ((1, 7), (0, 8)):
        assert (structured_light(depth, FX, *other) != first).mean() > 0.99
    assert first.dtype == np.float32


def test_a_sequence_is_read_with_noise_in_any_order(tmp_path: Path) -> None:
    write_room(tmp_path / "room", count=4)
    clean = open_sequence(tmp_path / "room")
    config = Config.load(None, ["input.depth_noise=structured-light"]).input
    one, strided = open_sequence(tmp_path / "room", config), config.model_copy(update={"stride": 2})
    last = one.frame(3)
    one.frame(0)
    np.testing.assert_array_equal(one.frame(2).depth, open_sequence(tmp_path / "room", strided).frame(1).depth)
    np.testing.assert_array_equal(one.frame(3).depth, last.depth)
    exact = clean.frame(3).depth
    both = (exact > 0) & (last.depth > 0)
    assert both.mean() > 0.5
    assert 1e-4 < np.median(np.abs(last.depth - exact)[both]) < 0.05
    again = open_sequence(tmp_path / "room", InputConfig(depth_noise="structured-light", noise_seed=1))
    assert (again.frame(3).depth != last.depth).any()
