"""A drifting trajectory and its correction: submaps move, nothing is fused again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.map.scenes import box
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


ROW = [Box([x - 0.2, -0.2, 0.0], [x + 0.2, 0.2, 0.4]) for x in (0.0, 2.0, 4.0)]


def drifting():
    """Three boxes in turn, eight frames each, with poses that drift 5 mm a frame: (frame as recorded, true pose)."""
    names = dict.fromkeys(range(1, 4), "suitcase")
    for n in range(24):
        center, angle = [2.0 * (n // 8), 0.0, 0.2], np.pi / 4 * (n % 8)
        true = look_at(center + np.array([1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.7]), center)
        frame, ids = render([ROW[n // 8]], true, n)
        ids = np.where(ids > 0, n // 8 + 1, 0).astype(np.int32)
        drifted = true.copy()
        drifted[:3, 3] += [0.0, 0.005 * n, 0.0]
        truth = GroundTruth(instance=ids, names=names, things=frozenset(names))
        yield replace(frame, T_map_camera=drifted, truth=truth), true


def surface_errors(mapper: Mapper) -> list[float]:
    """Mean distance of each submap's surface from the nearest box's, metres."""
    shapes = [box(b.low.tolist(), b.high.tolist()) for b in ROW]
    found = [mapper.map.submap_mesh(s.id).vertices.astype(np.float64) for s in mapper.map.objects]
    return [float(np.min([np.abs(shape(v)) for shape in shapes], axis=0).mean()) for v in found]


def test_surfaces_that_drifted_come_to_lie_where_they_are() -> None:
    config = Config.load(None, ["perception.profile=groundtruth", "fusion.max_blocks=20000"])
    mapper, poses = Mapper(config), {}
    for frame, true in drifting():
        mapper.integrate(frame)
        poses[frame.index] = true
    before = surface_errors(mapper)
    mapper.update_poses(poses)
    after = surface_errors(mapper)
    print(f"surface error before {before}, after {after} m")
    assert len(before) == 3
    # What a box drifted while it was seen, up to 2 cm either way, stays in its submap.
    assert max(after) < 0.015
    assert before[2] > 2.5 * after[2]
    assert before[1] > 1.5 * after[1]
