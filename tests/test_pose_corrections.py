"""A drifting trajectory and its correction: submaps move, nothing is fused again."""

from __future__ import annotations

import numpy as np

from tests.scenes import Box, look_at, render
from uppm.core.config import Config
from uppm.core.types import GroundTruth
from uppm.pipeline import Mapper

BOXES = [Box([-0.2, -0.2, 0.0], [0.2, 0.2, 0.4]), Box([1.8, -0.2, 0.0], [2.2, 0.2, 0.4])]
NAMES = {1: "suitcase", 2: "suitcase"}
TRUE = np.array([[0.0, 0.0, 0.2], [2.0, 0.0, 0.2]])


def frames():
    """The first box, then the second with poses that have drifted: (frame as recorded, true pose)."""
    for n, angle in enumerate(np.linspace(0, 2 * np.pi, 16)):
        which = int(n >= 8)
        true = look_at(TRUE[which] + np.array([1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.7]), TRUE[which])
        frame, ids = render([BOXES[which]], true, n)
        ids = np.where(ids > 0, which + 1, 0).astype(np.int32)
        drifted = true.copy()
        drifted[:3, 3] += [0.0, 0.12 * which, 0.0]
        object.__setattr__(frame, "T_map_camera", drifted)
        object.__setattr__(frame, "truth", GroundTruth(instance=ids, names=NAMES, things=frozenset(NAMES)))
        yield frame, true


def errors(mapper: Mapper) -> list[float]:
    """Distance of each box's submap from where the box is, metres."""
    centers = np.stack([s.center for s in mapper.map.objects])
    return [float(np.linalg.norm(centers - true, axis=1).min()) for true in TRUE]


def test_correction_moves_what_drifted_and_nothing_else() -> None:
    config = Config.load(None, ["perception.profile=groundtruth", "fusion.max_blocks=20000"])
    mapper, true_poses = Mapper(config), {}
    for frame, true in frames():
        mapper.integrate(frame)
        true_poses[frame.index] = true
    before = errors(mapper)
    mapper.checkpoint()
    mapper.update_poses(true_poses | {99: np.eye(4)})
    after = errors(mapper)
    print(f"error before {before}, after {after} m")
    assert before[1] > 0.1
    assert max(after) < 0.045
    assert abs(after[0] - before[0]) < 1e-6
    written = mapper.checkpoint()
    last = {r.index: r for r in written.frames}[15].T_map_camera
    assert last is not None
    np.testing.assert_allclose(last, true_poses[15])
    assert sorted(r.index for r in written.frames) == list(range(16))
    np.testing.assert_allclose(written.submaps[-1].T_map_submap[:3, 3], [0, -0.12, 0], atol=1e-9)


def test_mapping_goes_on_in_the_corrected_map() -> None:
    config = Config.load(None, ["perception.profile=groundtruth", "fusion.max_blocks=20000"])
    mapper, poses = Mapper(config), {}
    for frame, true in frames():
        mapper.integrate(frame)
        poses[frame.index] = true
    mapper.update_poses(poses)
    for frame, true in frames():
        object.__setattr__(frame, "T_map_camera", true)
        object.__setattr__(frame, "index", frame.index + 16)
        mapper.integrate(frame)
    assert len(mapper.map.objects) == 2
    assert [s.views for s in mapper.map.objects] == [16, 16]
    assert max(errors(mapper)) < 0.045
