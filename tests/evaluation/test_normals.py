"""The distance along the ground truth's normal."""

from __future__ import annotations

import numpy as np
import pytest

from uppm.evaluation import normals
from uppm.evaluation.geometry import PointIndex, nearest_points


def sphere(n: int, radius: float, seed: int) -> np.ndarray:
    direction = np.random.default_rng(seed).normal(size=(n, 3))
    return radius * direction / np.linalg.norm(direction, axis=1, keepdims=True)


def test_what_is_off_along_the_normal_is_measured_and_what_is_off_aside_is_not() -> None:
    step = np.arange(-30, 31) * 0.01
    truth = np.stack([*np.meshgrid(step, step), np.zeros((61, 61))], axis=-1).reshape(-1, 3)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    points = np.random.default_rng(0).uniform(-0.25, 0.25, (2000, 3)) * [1, 1, 0] + [0, 0, 0.013]
    points, truth = (points @ turn.T).astype(np.float64), PointIndex((truth @ turn.T).astype(np.float64))
    nearest = nearest_points(points, truth)
    assert normals.accuracy_along_normal(points, truth, nearest) == pytest.approx(1.3, abs=1e-6)
    assert 100 * nearest.to_truth.mean() > 1.32


def test_normals_of_a_sphere_point_to_its_centre() -> None:
    points = sphere(20_000, 0.5, 0)
    found = normals.estimated_normals(PointIndex(points), np.arange(0, 20_000, 40))
    assert np.abs(np.einsum("ij,ij->i", found, points[::40] / 0.5)).min() > 0.98


def test_a_seeded_choice_stands_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, points = PointIndex(sphere(20_000, 0.5, 0)), sphere(5_000, 0.51, 1)
    nearest = nearest_points(points, truth)
    every = normals.accuracy_along_normal(points, truth, nearest)
    monkeypatch.setattr(normals, "SAMPLES", 1_000)
    some = normals.accuracy_along_normal(points, truth, nearest, seed=3)
    assert every == pytest.approx(1.0, abs=0.03)
    assert some == pytest.approx(every, abs=0.01)
    assert some == normals.accuracy_along_normal(points, truth, nearest, seed=3)
