from __future__ import annotations

import numpy as np
import pytest

from tests.evaluation.scenes import mesh_of, square
from uppm.core.errors import InputError
from uppm.evaluation.sampling import SurfacePart, sample_parts, sample_surface


def test_density_is_points_per_square_metre() -> None:
    assert len(sample_surface(square(0, 0, 0, side=2), points_per_m2=2500)) == 10_000


def test_points_lie_on_the_surface_evenly() -> None:
    points = sample_surface(square(3, -1, 0.5), points_per_m2=40_000)
    np.testing.assert_allclose(points[:, 2], 0.5)
    counts, _, _ = np.histogram2d(points[:, 0] - 3, points[:, 1] + 1, bins=4, range=[[0, 1], [0, 1]])
    # 2500 expected in each of the 16 cells, standard deviation 48.
    assert np.abs(counts - 2500).max() < 5 * 48
    assert counts.sum() == 40_000


def test_large_triangles_get_their_share() -> None:
    mesh = mesh_of(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5], [3, 0, 5], [0, 3, 5], [9, 9, 9]], [[0, 1, 2], [3, 4, 5], [6, 6, 6]]
    )
    points = sample_surface(mesh, points_per_m2=20_000)
    assert len(points) == 100_000
    assert np.mean(points[:, 2] > 1) == pytest.approx(0.9, abs=0.005)


def test_seed_decides() -> None:
    mesh = square(0, 0, 0)
    np.testing.assert_array_equal(sample_surface(mesh, seed=7), sample_surface(mesh, seed=7))
    assert not np.array_equal(sample_surface(mesh, seed=7), sample_surface(mesh, seed=8))


def test_a_point_cloud_is_its_own_sample() -> None:
    np.testing.assert_array_equal(sample_surface(mesh_of([[1, 2, 3], [4, 5, 6]])), [[1, 2, 3], [4, 5, 6]])


def test_parts_keep_their_ids() -> None:
    parts = [SurfacePart(id=4, mesh=square(0, 0, 0)), SurfacePart(id=9, mesh=square(0, 0, 1, side=0.5))]
    samples = sample_parts(parts, points_per_m2=400)
    ids, counts = np.unique(samples.part, return_counts=True)
    assert (ids.tolist(), counts.tolist()) == ([4, 9], [400, 100])
    np.testing.assert_allclose(samples.points[samples.part == 9, 2], 1)


def test_no_surface_is_an_error() -> None:
    with pytest.raises(InputError, match=r"room\.uppm: expected a reconstructed surface, found an empty map"):
        sample_parts([], source="room.uppm")
    with pytest.raises(InputError, match="1 submaps without any"):
        sample_parts([SurfacePart(id=1, mesh=mesh_of(np.empty((0, 3))))])
