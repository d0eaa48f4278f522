"""What submaps live through: evidence for and against them, duplicates, range, freespace, noise and threads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from tests.fusion.scenes import RING, TARGET, new_fusion, objects, see, settings, vertices
from tests.scenes import Box, Plane, Sphere, described, look_at, render
from uppm._kernels.reference import voxel_centers
from uppm.core.types import SubmapKind, SubmapState
from uppm.datasets.noise import structured_light
from uppm.fusion.engine import PanopticFusion

BALL, FLOOR = Sphere([0, 0, 0.4], 0.3), Plane([0, 0, 1], 0.0)
NAMES = [("ball", "sports ball"), ("floor", "floor-other")]
APART = {"min_iou": 1.0, "min_containment": None, "merge_frames": None, "belonging": "once", "miss_penalty": 0}
"""With these, each frame's segments found submaps of their own, which keep their surface."""


def balls(fusion: PanopticFusion) -> int:
    return sum(s.kind is SubmapKind.OBJECT for s in objects(fusion))


@pytest.mark.parametrize(
    ("names", "cosine", "left"),
    [(["ball"] * 4, 0.0, 1), (["apple", "orange"] * 2, 0.9, 1), (["apple", "orange"] * 2, 0.2, 2)],
)
def test_duplicates_merge_at_the_end_by_geometry_and_descriptors(names: list[str], cosine: float, left: int) -> None:
    fusion = new_fusion(settings(**APART), apple__orange=cosine)
    for n, name in enumerate(names):
        # The same side, so that every two of them overlap.
        see(fusion, [BALL], [(name, "sports ball" if name == "ball" else name)], n, eye=RING[0])
    assert balls(fusion) == 4
    fusion.finish()
    assert balls(fusion) == left
    counts = [r.count for s in objects(fusion) if s.descriptor for r in s.descriptor.labels]
    assert sum(counts) == 4
    assert fusion.dropped["duplicate submap merged"] == 4 - left


def test_what_lies_apart_does_not_merge_at_the_end() -> None:
    fusion = new_fusion()
    pair = [Sphere([-0.4, 0, 0.4], 0.25), Sphere([0.4, 0, 0.4], 0.25)]
    for n in range(4):
        see(fusion, pair, [NAMES[0], NAMES[0]], n)
    fusion.finish()
    assert balls(fusion) == 2


@pytest.mark.parametrize(("merge_deactivated", "left"), [("all", 3), ("none", 99)])
def test_a_submap_merges_with_its_duplicates_when_it_becomes_inactive(merge_deactivated: str, left: int) -> None:
    fusion = new_fusion(settings(**APART, max_misses=2, merge_deactivated=merge_deactivated))
    for n in range(9):
        see(fusion, [BALL], NAMES[:1], n, eye=RING[0])
    assert balls(fusion) <= left
    assert (balls(fusion) > 5) == (merge_deactivated == "none")
    assert sum(r.count for s in objects(fusion) if s.descriptor for r in s.descriptor.labels) == 9


def test_an_object_that_is_seen_through_is_given_up() -> None:
    present, gone = new_fusion(), new_fusion()
    for n in range(3):
        for fusion in (present, gone):
            see(fusion, [BALL, FLOOR], NAMES, n, eye=RING[0])
    for n in range(3, 6):
        # There, but without a segment; and gone, so that the floor shows behind it.
        see(present, [BALL, FLOOR], NAMES, n, eye=RING[0], segments=[0, 2])
        see(gone, [FLOOR], NAMES, n, eye=RING[0], segments=[2])
    there, not_there = (s.evidence for f in (present, gone) for s in objects(f) if s.kind is SubmapKind.OBJECT)
    assert there == pytest.approx(3 - 3 * 0.05)
    assert not_there <= 1
    for fusion, left in ((present, 1), (gone, 0)):
        fusion.finish()
        assert balls(fusion) == left
    # Its surface was carved away: it does not come back as unlabeled background.
    assert not [s for s in gone.submaps() if s.descriptor is None and s.kind is not SubmapKind.FREESPACE]


@pytest.mark.parametrize("unlabeled_before", [False, True])
def test_what_was_named_too_seldom_stays_as_unlabeled_surface(*, unlabeled_before: bool) -> None:
    fusion, floor = new_fusion(), 0 if unlabeled_before else 2
    for n in range(3):
        see(fusion, [BALL, FLOOR], NAMES, n, eye=RING[3], segments=[1, floor])
    # Another ball, once and with a low score.
    second = Sphere([0.9, 0, 0.4], 0.25)
    see(fusion, [second, BALL, FLOOR], NAMES, 3, eye=RING[3], segments=[1, 0, floor], score=0.5)
    tentative = [s for s in objects(fusion) if s.state is SubmapState.TENTATIVE]
    assert len(tentative) == 1
    fusion.finish()
    assert not [s for s in objects(fusion) if s.state is SubmapState.TENTATIVE]
    (rest,) = [s for s in fusion.submaps() if s.descriptor is None and s.kind is SubmapKind.BACKGROUND]
    assert (rest.state, rest.voxel_size) == (SubmapState.CONFIRMED, fusion._config.unlabeled_voxel_size)
    distance = np.linalg.norm(vertices(fusion, rest) - second.center, axis=1)
    assert (np.abs(distance - second.radius) < 0.03).sum() > 50


def test_a_surface_that_a_mask_leaked_onto_goes_back_to_whom_most_frames_saw_there() -> None:
    fusion = new_fusion()
    patch = Box([0.35, -0.2, -0.1], [0.7, 0.2, 0.001])

    def ball() -> npt.NDArray[np.float32]:
        (submap,) = [s for s in objects(fusion) if s.kind is SubmapKind.OBJECT]
        return vertices(fusion, submap)

    for n in range(6):
        see(fusion, [BALL, patch, FLOOR], NAMES, n, eye=RING[0], segments=[1, 1 if n == 5 else 2, 2])
    # A frame is enough where the ball's submap had no voxels before.
    assert (ball()[:, 2] < 0.02).mean() > 0.1
    fusion.finish()
    at = ball()
    assert (at[:, 2] < 0.02).mean() < 0.02
    assert (np.abs(np.linalg.norm(at - BALL.center, axis=1) - BALL.radius) < 0.02).mean() > 0.95


def test_an_object_that_is_seldom_found_keeps_its_surface() -> None:
    fusion = new_fusion()
    for n in range(9):
        # For long the ball is taken for a part of the floor.
        see(fusion, [BALL, FLOOR], NAMES, n, eye=RING[0], segments=[2 if n < 6 else 1, 2])
    fusion.finish()
    (ball,) = [s for s in objects(fusion) if s.kind is SubmapKind.OBJECT]
    distance = np.linalg.norm(vertices(fusion, ball) - BALL.center, axis=1)
    assert (np.abs(distance - BALL.radius) < 0.02).sum() > 300


def test_a_confirmed_object_that_is_missed_becomes_inactive_and_wakes() -> None:
    fusion, states = new_fusion(settings(max_misses=2)), []
    for n, shown in enumerate([1, 1, 0, 0, 0, 1]):
        see(fusion, [BALL, FLOOR], NAMES, n, eye=RING[0], segments=[shown, 2])
        states.append(next(s.state for s in objects(fusion) if s.kind is SubmapKind.OBJECT))
    assert states == [SubmapState.CONFIRMED] * 4 + [SubmapState.INACTIVE, SubmapState.CONFIRMED]


def test_depth_out_of_range_is_not_used() -> None:
    eye = [-2.0, 0.0, 0.8]
    fusion = new_fusion(settings(depth_min=1.5, depth_max=2.5))
    see(fusion, [FLOOR], [NAMES[1]], 0, eye=eye)
    (floor,) = objects(fusion)
    pose = look_at(eye, TARGET)
    z = ((vertices(fusion, floor) - pose[:3, 3]) @ pose[:3, :3])[:, 2]
    assert len(z) > 300
    assert z.min() > 1.5 - 2 * floor.voxel_size
    assert z.max() < 2.5 + 2 * floor.voxel_size
    whole = new_fusion()
    see(whole, [FLOOR], [NAMES[1]], 0, eye=eye)
    all_z = ((vertices(whole, objects(whole)[0]) - pose[:3, 3]) @ pose[:3, :3])[:, 2]
    assert all_z.max() > 3
    assert all_z.min() < 1.4


def test_what_goes_away_is_carved_free() -> None:
    fusion = new_fusion(settings(freespace_voxel_size=0.1))
    for n in range(3):
        see(fusion, [BALL, FLOOR], NAMES, n)

    def free() -> npt.NDArray[np.float64]:
        """Distances of freespace within the ball, in truncation distances."""
        (submap,) = [s for s in fusion.submaps() if s.kind is SubmapKind.FREESPACE]
        blocks = fusion.blocks(submap.id)
        inside = np.linalg.norm(voxel_centers(blocks.coords, submap.voxel_size) - [0, 0, 0.4], axis=-1) < 0.15
        return blocks.distance[inside & (blocks.weight > 0)] / 32767

    def surface() -> int:
        return sum(len(vertices(fusion, s)) for s in objects(fusion) if s.kind is SubmapKind.OBJECT)

    assert not (free() > 0.2).any()
    before = surface()
    for n in range(3, 24):
        see(fusion, [FLOOR], NAMES, n, segments=[2])
    assert len(free()) > 5
    assert free().min() > 0.2
    assert surface() < 0.5 * before


def wobbly_sequence(threads: int) -> PanopticFusion:
    """Twenty frames with sensor noise, masks that come, go, merge and fall apart, and the end of the session."""
    left, right = Box([-0.4, -0.2, 0], [0.0, 0.2, 0.4]), Box([0.0, -0.2, 0], [0.4, 0.2, 0.4])
    names = [("box", "suitcase"), ("box", "suitcase"), ("ball", "sports ball"), ("floor", "floor-other")]
    fusion, rng = new_fusion(settings(threads=threads, split_frames=3, merge_frames=2)), np.random.default_rng(5)
    for n in range(20):
        shapes = [left, right, Sphere([0.3, 0.6, 0.2], 0.2), FLOOR]
        frame, ids = render(shapes, look_at(RING[n % 12], TARGET), n)
        frame = replace(frame, depth=structured_light(frame.depth, frame.intrinsics.fx, 0, n))
        of_shape = np.array([0, 1, 1 if n < 8 or n > 15 else 2, int(rng.choice([0, 3])), 4], dtype=np.int32)
        fusion.fuse(frame, described(of_shape[ids], names))
    fusion.finish()
    return fusion


def test_a_whole_sequence_is_the_same_for_any_number_of_threads_and_again() -> None:
    one, two, again = (wobbly_sequence(threads) for threads in (1, 2, 2))
    assert one.dropped == two.dropped == again.dropped
    assert sum(one.dropped.values()) > 0
    for other in (two, again):
        for a, b in zip(one.submaps(), other.submaps(), strict=True):
            assert (a.id, a.views, a.state, a.evidence, a.descriptor) == (
                b.id,
                b.views,
                b.state,
                b.evidence,
                b.descriptor,
            )
            x, y = one.blocks(a.id), other.blocks(b.id)
            for name in ("coords", "distance", "weight", "color", "belonging"):
                np.testing.assert_array_equal(getattr(x, name), getattr(y, name))
