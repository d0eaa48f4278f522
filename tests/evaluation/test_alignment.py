"""Frames that differ by a rigid motion: found, said, and undone on request."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from tests.evaluation.scenes import grid, mesh_of
from uppm.core.geometry import transform
from uppm.evaluation.alignment import find_misalignment
from uppm.evaluation.ground_truth import SurfaceTruth, TruthInstance
from uppm.evaluation.map_evaluation import Reconstruction, evaluate_map
from uppm.evaluation.sampling import SurfacePart


def room() -> npt.NDArray[np.float64]:
    """A floor, two walls of different size, and a box's top, 2 cm apart."""
    floor = grid(0, 0, 0, side=3, step=0.02)
    wall = grid(0, 0, 0, side=2, step=0.02)
    return np.concatenate([floor, wall[:, [0, 2, 1]], (wall * [1, 1.4, 1])[:, [2, 1, 0]], grid(1.2, 2, 0.6, side=0.5)])


def motion(degrees: float, *shift: float, axis: tuple[float, float, float] = (0.3, 0.2, 1)) -> npt.NDArray[np.float64]:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    T[:3, 3] = shift
    return T


def noisy(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return points + np.random.default_rng(0).normal(0, 0.004, points.shape)


@pytest.mark.parametrize(
    "T",
    [
        motion(0, 0.03, 0, 0),
        motion(2, 0.02, -0.03, 0.01),
        motion(8, 0.1, 0.2, -0.05),
        motion(90, 0, 0, 0, axis=(0, 0, 1)),
        motion(180, 0.4, 0, 0.2, axis=(1, 0, 0)),
    ],
    ids=["3 cm", "2 degrees", "8 degrees", "other axes", "upside down"],
)
def test_the_motion_is_found(T: npt.NDArray[np.float64]) -> None:
    found = find_misalignment(noisy(transform(T, room())), room())
    assert found is not None
    assert np.abs(found.T_truth_map @ T - np.eye(4)).max() < 0.03
    assert found.after_cm < min(1.2, 0.8 * found.before_cm)
    assert found.rotation_deg == pytest.approx(np.rad2deg(Rotation.from_matrix(T[:3, :3]).magnitude()), abs=1)


def test_no_motion_is_found_where_there_is_none() -> None:
    assert find_misalignment(noisy(room()), room()) is None
    # Half of the room: nothing pulls it to where it is not.
    half = room()[room()[:, 0] < 1.5]
    assert find_misalignment(noisy(half), room()) is None


def test_the_same_answer_a_second_time() -> None:
    a, b = (find_misalignment(noisy(transform(motion(3, 0.1, 0, 0), room())), room()) for _ in range(2))
    assert a is not None
    assert b is not None
    assert (a.T_truth_map == b.T_truth_map).all()


def truth(points: npt.NDArray[np.float64], *, is_observed: bool = True, known: bool = True) -> SurfaceTruth:
    floor = TruthInstance(id=1, name="floor", is_thing=False, categories=("floor-other",), pixels=10**6)
    gone = TruthInstance(id=2, name="cup", is_thing=True, categories=("cup",), pixels=10**6)
    return SurfaceTruth(
        source="truth",
        points=points,
        instance=np.full(len(points), int(known), dtype=np.int32),
        instances={1: floor, 2: gone},
        is_observed=is_observed,
    )


def cloud(points: npt.NDArray[np.float64]) -> Reconstruction:
    return Reconstruction(source="cloud.ply", parts=(SurfacePart(id=1, mesh=mesh_of(points), category="floor-other"),))


def test_it_is_said_and_undone_on_request() -> None:
    moved = cloud(noisy(transform(motion(2, 0.1, 0.05, 0), room())))
    said = evaluate_map(moved, truth(room()))
    assert not said.aligned
    assert said.misalignment_cm == pytest.approx(11, abs=4)
    assert said.misalignment_deg == pytest.approx(2, abs=1)
    assert "measure with --align" in said.notes[0]
    undone = evaluate_map(moved, truth(room()), align=True)
    assert undone.aligned
    assert "it was moved there" in undone.notes[0]
    assert undone.geometry.accuracy_cm < 1 < said.geometry.accuracy_cm
    straight = evaluate_map(cloud(noisy(room())), truth(room()), align=True)
    assert not straight.aligned
    assert straight.misalignment_cm is None
    assert straight.notes == ()


def test_ground_truth_that_does_not_cover_the_map() -> None:
    part = room()[room()[:, 0] < 1]
    assert "which does not cover it" in evaluate_map(cloud(room()), truth(part)).notes[-1]


def test_what_is_not_known_is_said() -> None:
    found = evaluate_map(cloud(room()), truth(room(), is_observed=False, known=False))
    assert "the ground truth is a whole scan" in found.notes[0]
    assert "100% of the ground truth is of unknown instances" in found.notes[1]


def test_classes_without_an_instance_are_excluded_and_counted() -> None:
    found = evaluate_map(cloud(room()), truth(room()))
    assert found.panoptic is not None
    assert found.classes_excluded == 1
    assert found.panoptic.classes == 1
    assert "cup" not in found.panoptic.per_class


def test_a_map_on_unknown_surface_is_neither_right_nor_wrong() -> None:
    other = replace(truth(room()), instance=np.zeros(len(room()), dtype=np.int32))
    found = evaluate_map(cloud(room()), other).instances
    assert found is not None
    assert found.unmatched_submaps == 0
