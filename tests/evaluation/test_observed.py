"""What of a scan the cameras saw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uppm.core.types import GroundTruth
from uppm.evaluation.ground_truth import SurfaceTruth, TruthInstance
from uppm.evaluation.observed import observe
from uppm.perception.fakes import fake_frame


def truth(points: list[list[float]], instance: list[int]) -> SurfaceTruth:
    known = {
        7: TruthInstance(id=7, name="chair", is_thing=True, categories=("chair",), pixels=None),
        8: TruthInstance(id=8, name="wall", is_thing=False, categories=("wall-other",), pixels=None),
    }
    return SurfaceTruth(
        source="scan",
        points=np.array(points),
        instance=np.array(instance, dtype=np.int32),
        instances=known,
        is_observed=False,
    )


def test_only_what_agrees_with_the_depth_within_range_is_seen() -> None:
    # The frame looks along z at a wall 2 m away.
    scan = truth([[0, 0, 2], [0, 0, 2.04], [0, 0, 1.9], [0, 0, 2.5], [9, 0, 2], [0, 0, -2]], [8] * 6)
    seen = observe(scan, [fake_frame()])
    assert seen.points[:, 2].tolist() == [2, 2.04]
    assert seen.is_observed
    assert len(observe(scan, [fake_frame()], depth_max=1.5).points) == 0
    assert len(observe(scan, []).points) == 0


def test_unknown_points_take_the_instance_that_the_nearest_frame_shows() -> None:
    frame = fake_frame()
    half = np.full(frame.depth.shape, 8, dtype=np.int32)
    half[:, :32] = 7
    far = replace(frame, truth=GroundTruth(instance=half, names={7: "chair", 8: "wall"}, things=frozenset({7})))
    near_pose = np.eye(4)
    near_pose[2, 3] = 1.0
    strange = np.full(frame.depth.shape, 99, dtype=np.int32)
    near = replace(
        frame,
        depth=np.full_like(frame.depth, 1.0),
        T_map_camera=near_pose,
        truth=GroundTruth(instance=strange, names={99: "?"}, things=frozenset()),
    )
    scan = truth([[-0.9, 0, 2], [0.9, 0, 2], [0.9, 0.01, 2]], [0, 0, 7])
    seen = observe(scan, [far])
    # The third is annotated in the scan itself.
    assert seen.instance.tolist() == [7, 8, 7]
    assert seen.instances[7].pixels == 32 * 48
    # From the nearer frame, the first two are out of view; what it alone sees it names by an id that nobody knows.
    assert observe(truth([[0, 0, 2]], [0]), [far, near]).instance.tolist() == [0]
