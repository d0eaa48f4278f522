"""The rasteriser against its NumPy reference and by hand."""

from __future__ import annotations

import numpy as np
import pytest

from uppm._kernels import raster

NOTHING = np.zeros((6, 1), np.float32)


def triangles(seed: int, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-15, 95, 3 * n), rng.uniform(-15, 65, 3 * n), rng.uniform(0.1, 5, 3 * n)])
    return points, np.arange(3 * n, dtype=np.int32).reshape(n, 3)


@pytest.mark.parametrize("seed", range(4))
def test_kernel_agrees_with_reference(seed: int) -> None:
    points, faces = triangles(seed)
    values = np.random.default_rng(seed).uniform(0, 255, (len(points), 6)).astype(np.float32)
    face, nearness, pixels = raster.rasterize(points, faces, values, 50, 80)
    expected_face, expected_nearness, expected_pixels = raster.rasterize_reference(points, faces, values, 50, 80)
    assert (face >= 0).mean() > 0.3
    np.testing.assert_array_equal(face, expected_face)
    np.testing.assert_allclose(nearness, expected_nearness, rtol=1e-12)
    np.testing.assert_allclose(pixels, expected_pixels, rtol=1e-4, atol=1e-3)


def test_square_of_two_triangles_has_no_gap_and_one_side() -> None:
    points = np.array([[2, 7, 1], [9, 7, 1], [9, 1, 1], [2, 1, 1]], dtype=np.float64)
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    face, nearness, _ = raster.rasterize(points, faces, NOTHING[:4], 10, 12)
    inside = np.zeros((10, 12), dtype=bool)
    inside[1:8, 2:10] = True
    np.testing.assert_array_equal(face >= 0, inside)
    assert (nearness[inside] == 1).all()
    assert np.isneginf(nearness[~inside]).all()
    behind, *_ = raster.rasterize(points, np.ascontiguousarray(faces[:, ::-1]), NOTHING[:4], 10, 12)
    assert (behind == -1).all()


def test_nearer_face_wins_in_any_order() -> None:
    square = np.array([[0, 9], [9, 9], [0, 0]], dtype=np.float64)
    points = np.concatenate([np.column_stack([square, np.full(3, near)]) for near in (1.0, 2.0)])
    for faces in ([[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]]):
        face, nearness, _ = raster.rasterize(points, np.array(faces, dtype=np.int32), NOTHING, 10, 10)
        assert nearness.max() == 2
        assert faces[face[8, 1]] == [3, 4, 5]


def test_nothing_to_draw() -> None:
    face, *_ = raster.rasterize(np.empty((0, 3)), np.empty((0, 3), np.int32), NOTHING[:0], 4, 5)
    assert (face == -1).all()
