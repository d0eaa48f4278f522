"""The simulated camera blurs the frames that the captioner calls blurred, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from uppm.core.config import SimulatedConfig
from uppm.perception.fakes import FakeFrameSource, fake_frame
from uppm.perception.simulated.camera import SimulatedCamera, blurred, motion_kernel
from uppm.perception.simulated.noise import blur_noise


def test_the_frames_that_are_blurred_are_those_of_the_noise() -> None:
    config, source = SimulatedConfig(blurred=0.4, blur_pixels=200), FakeFrameSource(40)
    camera = SimulatedCamera(source, config)
    assert (camera.name, list(camera.indices), len(camera)) == (source.name, list(source.indices), 40)
    changed = [bool((camera.frame(n).color != source.frame(n).color).any()) for n in range(40)]
    told = [blur_noise(n, config) for n in range(40)]
    assert not any(change and not noise.blurred for change, noise in zip(changed, told, strict=True))
    # A blur along the edge between the two halves of the fake frame leaves it sharp.
    across = [
        change for change, noise in zip(changed, told, strict=True) if noise.blurred and abs(np.cos(noise.angle)) > 0.2
    ]
    assert all(across)
    assert len(across) > 5


def test_depth_lies_between_two_surfaces_at_an_edge_and_stays_unknown_where_it_is() -> None:
    frame = fake_frame(depth=2.0)
    frame.depth[:, 32:] = 4.0
    frame.depth[:5] = 0
    seen = blurred(frame, 9, 0.0)
    assert (seen.depth[:5] == 0).all()
    assert (seen.depth[10, 31:33] > 2.2).all()
    assert (seen.depth[10, 31:33] < 3.8).all()
    assert seen.depth[10, 5] == pytest.approx(2)
    assert seen.depth[5, 60] == pytest.approx(4)
    assert frame.depth[10, 31] == 2.0


def test_along_an_edge_nothing_changes() -> None:
    frame = fake_frame()
    np.testing.assert_array_equal(blurred(frame, 9, np.pi / 2).color, frame.color)


def test_the_kernel_is_a_line_of_the_length() -> None:
    kernel = motion_kernel(9, 0.0)
    assert kernel.sum() == pytest.approx(1)
    assert np.count_nonzero(kernel.sum(axis=1)) == 1
    assert 9 <= np.count_nonzero(kernel) <= 11
    np.testing.assert_allclose(motion_kernel(0, 1.0), [[1]])
