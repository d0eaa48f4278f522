from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from tests.evaluation.scenes import grid, square
from uppm.core.errors import InputError
from uppm.evaluation.geometry import PointIndex, f1, geometric_metrics, nearest_points, share_within
from uppm.evaluation.sampling import sample_surface

Points = npt.NDArray[np.float64]


def brute_force(reconstruction: Points, truth: Points) -> dict[str, float]:
    """The definitions once more, over the full matrix of distances."""
    matrix = 100 * cdist(reconstruction, truth)
    r, g = matrix.min(axis=1), matrix.min(axis=0)
    accuracy, completeness = sum(r) / len(r), sum(g) / len(g)
    precision, recall = sum(r <= 5) / len(r), sum(g <= 5) / len(g)
    total = precision + recall
    return {
        "accuracy_cm": accuracy,
        "completeness_cm": completeness,
        "chamfer_l1_cm": accuracy + completeness,
        "chamfer_l1_half_cm": 0.5 * (accuracy + completeness),
        "chamfer_squared_cm2": sum(r * r) / len(r) + sum(g * g) / len(g),
        "chamfer_cm": (sum(r * r) / len(r) + sum(g * g) / len(g)) ** 0.5,
        "hausdorff_cm": max(max(r), max(g)),
        "hausdorff_95_cm": max(np.quantile(r, 0.95), np.quantile(g, 0.95)),
        "completion_ratio_5cm": recall,
        "precision_5cm": precision,
        "recall_5cm": recall,
        "f1_5cm": 2 * precision * recall / total if total else 0.0,
    }


def test_hand_computed() -> None:
    truth = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0.0]])
    reconstruction = np.array([[0, 0, 0.03], [1, 0, 0.04], [2.0, 0, 0.12]])
    # R -> G: 3, 4, 12 cm; G -> R: 3, 4, 12 and sqrt(100^2 + 12^2) cm.
    far = np.sqrt(100**2 + 12**2)
    found = geometric_metrics(nearest_points(reconstruction, PointIndex(truth)))
    assert found.accuracy_cm == pytest.approx(19 / 3)
    assert found.completeness_cm == pytest.approx((19 + far) / 4)
    assert found.chamfer_l1_cm == pytest.approx(19 / 3 + (19 + far) / 4)
    assert found.chamfer_l1_half_cm == pytest.approx(found.chamfer_l1_cm / 2)
    assert found.chamfer_cm == pytest.approx(np.sqrt(169 / 3 + (169 + far**2) / 4))
    assert found.hausdorff_cm == pytest.approx(far)
    assert found.completion_ratio_5cm == found.recall_5cm == pytest.approx(0.5)
    assert found.precision_5cm == pytest.approx(2 / 3)
    assert found.f1_5cm == pytest.approx(4 / 7)
    assert found.f1_foreground_5cm is None


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 120), m=st.integers(1, 120), scale=st.sampled_from([0.05, 0.5]))
def test_agrees_with_brute_force(seed: int, n: int, m: int, scale: float) -> None:
    random = np.random.default_rng(seed)
    reconstruction, truth = scale * random.normal(size=(n, 3)), scale * random.normal(size=(m, 3))
    found = geometric_metrics(nearest_points(reconstruction, PointIndex(truth)))
    for name, value in brute_force(reconstruction, truth).items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-9, abs=1e-9), name


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 80), m=st.integers(2, 80))
def test_the_foreground_agrees_with_brute_force(seed: int, n: int, m: int) -> None:
    random = np.random.default_rng(seed)
    reconstruction, truth = 0.08 * random.normal(size=(n, 3)), 0.08 * random.normal(size=(m, 3))
    foreground = random.random(m) < 0.5
    foreground[0] = True
    matrix = cdist(reconstruction, truth)
    hits = [row.min() <= 0.05 for row in matrix if foreground[row.argmin()]]
    found = [column.min() <= 0.05 for column, wanted in zip(matrix.T, foreground, strict=True) if wanted]
    precision, recall = (sum(hits) / len(hits) if hits else 0.0), sum(found) / len(found)
    expected = 2 * precision * recall / (precision + recall) if precision + recall else 0.0
    metrics = geometric_metrics(nearest_points(reconstruction, PointIndex(truth)), foreground)
    assert metrics.f1_foreground_5cm == pytest.approx(expected)


@pytest.mark.parametrize("offset_cm", [0.0, 2.0, 5.5])
def test_a_plane_above_a_plane(offset_cm: float) -> None:
    reconstruction = sample_surface(square(0, 0, offset_cm / 100))
    found = geometric_metrics(nearest_points(reconstruction, PointIndex(grid(0, 0, 0))))
    # Ground truth 1 cm apart: a perfect surface has 0.38 cm, the mean distance to a lattice's nearest point.
    lateral = 0.3826
    assert found.accuracy_cm == pytest.approx(np.hypot(offset_cm, lateral), abs=0.04)
    assert found.completion_ratio_5cm == (offset_cm < 5)


def test_background_is_left_out_of_the_foreground_score() -> None:
    floor, mug = grid(0, 0, 0, step=0.05), grid(0.4, 0.4, 0.3, side=0.2, step=0.02)
    truth = np.concatenate([floor, mug])
    foreground = np.repeat([False, True], [len(floor), len(mug)])
    missed = geometric_metrics(nearest_points(floor, PointIndex(truth)), foreground)
    assert missed.f1_foreground_5cm == 0
    assert missed.f1_5cm > 0.8
    partly = np.concatenate([floor, mug[: len(mug) // 2] + np.array([0, 0, 0.01])])
    half = geometric_metrics(nearest_points(partly, PointIndex(truth)), foreground)
    # Precision 1; recall: the 5 rows of 10 that are there and 2 more, 2 and 4 cm beside them.
    assert half.f1_foreground_5cm == pytest.approx(2 * 0.7 / 1.7)
    nothing = np.zeros(len(floor), bool)
    assert geometric_metrics(nearest_points(floor, PointIndex(floor)), nothing).f1_foreground_5cm is None


def test_threshold_belongs_and_f1_of_nothing_is_zero() -> None:
    assert share_within(np.array([0.05, 0.0501])) == 0.5
    assert f1(0.0, 0.0) == 0.0


@pytest.mark.parametrize(("n", "m", "name"), [(0, 3, "reconstruction"), (3, 0, "ground truth")])
def test_empty_sets_are_errors(n: int, m: int, name: str) -> None:
    with pytest.raises(InputError, match=f"^{name}: expected points"):
        nearest_points(np.zeros((n, 3)), PointIndex(np.zeros((m, 3))))


@pytest.mark.parametrize("scale", [0.02, 0.5, 5.0])
def test_near_and_far_queries_find_the_nearest(scale: float) -> None:
    random = np.random.default_rng(4)
    points, queries = random.uniform(0, 0.3, (3000, 3)), scale * random.normal(size=(500, 3))
    distance, index = PointIndex(points).nearest(queries)
    matrix = cdist(queries, points)
    assert (index == matrix.argmin(axis=1)).all()
    assert distance == pytest.approx(matrix.min(axis=1), rel=1e-12)


@pytest.mark.heavy
def test_a_million_points_against_a_million_within_twenty_seconds_of_two_cores() -> None:
    random = np.random.default_rng(0)
    # Two rooms: the faces of two boxes of 5 m.
    truth = random.uniform(0, 1, (1_000_000, 3)) * 5 + random.integers(0, 2, (1_000_000, 1)) * 5
    face = random.integers(0, 3, 1_000_000)
    truth[np.arange(1_000_000), face] = 5 * np.rint(truth[np.arange(1_000_000), face] / 5)
    reconstruction = truth + random.normal(0, 0.02, truth.shape)
    start = time.process_time()
    metrics = geometric_metrics(nearest_points(reconstruction, PointIndex(truth)))
    # Processor time, since the machine may be busy with other things.
    assert time.process_time() - start < 2 * 20
    assert 0.5 < metrics.accuracy_cm < 3.5
