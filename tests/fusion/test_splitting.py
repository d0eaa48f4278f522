"""One submap observed as two objects for long becomes two; two covered by one segment become one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from tests.fusion.scenes import new_fusion, objects, see, settings, similarity, vertices
from tests.map.scenes import checkpoint_of, submap_of
from tests.scenes import Box, Plane
from uppm.core.types import Submap, SubmapState
from uppm.fusion import merging, splitting
from uppm.fusion.engine import PanopticFusion
from uppm.fusion.submaps import LiveSubmap
from uppm.map.store import MapReader, MapWriter

LEFT, RIGHT, FLOOR = Box([-0.4, -0.2, 0], [0.0, 0.2, 0.4]), Box([0.0, -0.2, 0], [0.4, 0.2, 0.4]), Plane([0, 0, 1], 0.0)
SHAPES = [LEFT, RIGHT, FLOOR]
NAMES = [("box", "suitcase"), ("floor", "floor-other"), ("box", "suitcase")]
ONE, TWO = [1, 1, 2], [1, 3, 2]
"""Segments of the two boxes and the floor: seen as one box, and as two."""


def run(fusion: PanopticFusion, sights: Sequence[Sequence[int]], first: int = 0) -> list[int]:
    """Number of boxes after each frame."""
    counts = []
    for n, segments in enumerate(sights, start=first):
        see(fusion, SHAPES, NAMES, n, segments=segments)
        counts.append(len(boxes(fusion)))
    return counts


def boxes(fusion: PanopticFusion) -> list[Submap]:
    return [s for s in objects(fusion) if s.descriptor and s.descriptor.category.name == "suitcase"]


def owned(fusion: PanopticFusion, submap: Submap) -> npt.NDArray[np.bool_]:
    blocks = fusion.blocks(submap.id)
    mine, foreign = blocks.belonging[..., 0], blocks.belonging[..., 1]
    return (blocks.weight > 0) & (mine > 0) & (mine >= foreign)


def test_two_boxes_seen_as_one_and_then_as_two() -> None:
    fusion = new_fusion(settings(split_frames=5))
    # All around, so that what is seen as two was seen before.
    assert run(fusion, [ONE] * 12) == [1] * 12
    (whole,) = boxes(fusion)
    kept = owned(fusion, whole).sum()
    # The fifth frame that sees two splits it.
    assert run(fusion, [TWO] * 5, first=12) == [1, 1, 1, 1, 2]
    a, b = sorted(boxes(fusion), key=lambda s: s.center[0])
    # Nothing is lost: what the whole had is now one's or the other's, and the back, last seen as one, is divided too.
    assert owned(fusion, a).sum() + owned(fusion, b).sum() >= 0.98 * kept
    for submap, box in ((a, LEFT), (b, RIGHT)):
        at = vertices(fusion, submap)
        low, high = box.low - submap.voxel_size, box.high + submap.voxel_size
        # Corners of the sides that face the camera, all around.
        assert ((at >= low) & (at <= high)).all(axis=1).mean() > 0.98
        assert (at.max(axis=0) - at.min(axis=0) > [0.36, 0.36, 0.3]).all()
    assert run(fusion, [TWO] * 3, first=17) == [2] * 3
    assert [s.state for s in (a, b)] == [SubmapState.CONFIRMED] * 2
    assert [{r.text for r in s.descriptor.labels} for s in boxes(fusion) if s.descriptor] == [{"box"}] * 2
    assert {s.id for s in boxes(fusion)} == {a.id, b.id}


def test_what_the_other_box_was_seen_at_goes_over_to_it() -> None:
    fusion = new_fusion(settings(split_frames=5))
    # From one side only: on the other, the right box founds a submap of its own at once.
    assert run(fusion, [ONE] * 6) == [1] * 6
    assert run(fusion, [TWO] * 6, first=6)[-1] == 2
    a, b = sorted(boxes(fusion), key=lambda s: s.center[0])
    assert vertices(fusion, a)[:, 0].max() <= a.voxel_size
    across = vertices(fusion, b)
    # The side that was seen before there were two.
    assert (across[:, 1] > 0.18).sum() > 100
    assert across[:, 0].min() >= -1.01 * b.voxel_size
    assert [s.views for s in (a, b)] == [12, 5]


def test_frames_that_see_one_speak_against_two() -> None:
    fusion = new_fusion(settings(split_frames=5))
    assert run(fusion, [ONE] * 12) == [1] * 12
    assert run(fusion, [TWO if n % 2 else ONE for n in range(24)], first=12) == [1] * 24
    never = new_fusion(settings(split_frames=None))
    assert run(never, [ONE] * 12 + [TWO] * 8) == [1] * 20


def test_segments_that_fall_apart_another_way_each_time_split_nothing() -> None:
    fusion = new_fusion(settings(split_frames=3))
    whole = Box([-0.4, -0.2, 0], [0.4, 0.2, 0.4])
    quarters = [Box([x, y, 0], [x + 0.4, y + 0.2, 0.4]) for x in (-0.4, 0.0) for y in (-0.2, 0.0)]
    for n in range(12):
        see(fusion, [whole, FLOOR], NAMES, n, segments=[1, 2])
    for n in range(12, 24):
        # Left from right, then front from back.
        segments = [1, 1, 3, 3, 2] if n % 2 else [1, 3, 1, 3, 2]
        see(fusion, [*quarters, FLOOR], NAMES, n, segments=segments)
    assert len(boxes(fusion)) == 1


def test_one_segment_over_both_merges_them_again_and_seeing_both_speaks_against() -> None:
    fusion = new_fusion(settings(merge_frames=3))
    assert run(fusion, [TWO] * 3) == [2] * 3
    # Two frames after the first showed them apart, and one more does: one segment over both must do so in three more.
    assert run(fusion, [ONE, ONE, TWO, ONE, ONE], first=3) == [2] * 5
    assert run(fusion, [ONE, ONE], first=15) == [2, 1]
    (both,) = boxes(fusion)
    assert both.descriptor is not None
    assert sum(r.count for r in both.descriptor.labels) == 2 * 4 + 6
    extent = vertices(fusion, both)
    assert extent[:, 0].min() < -0.38
    assert extent[:, 0].max() > 0.38


def test_a_few_frames_with_one_segment_do_not_merge_what_many_showed_apart() -> None:
    fusion = new_fusion(settings(merge_frames=3))
    assert run(fusion, [TWO] * 8) == [2] * 8
    assert run(fusion, [ONE] * 4, first=12) == [2] * 4
    fusion.finish()
    assert len(boxes(fusion)) == 2


def test_what_was_counted_of_two_submaps_is_the_merged_ones() -> None:
    one, two, three = live(), live(), live()
    one.id, two.id, three.id = 1, 2, 3
    assert merging.count_together(three, one, -2) == merging.together(one, three) == -2
    assert merging.count_together(two, three, -3) == merging.together(three, two) == -3
    merging.inherit(one, two, [one, three])
    assert (one.companions, three.companions) == ({3: -5}, {})


def test_background_is_not_split() -> None:
    fusion = new_fusion(settings(split_frames=2))
    left, right = Box([-3, -3, -1], [0, 3, 0]), Box([0, -3, -1], [3, 3, 0])
    for n in range(10):
        names = [("floor", "floor-other"), ("floor", "floor-other")]
        see(fusion, [left, right], names, n, segments=[1, 1] if n < 4 else [1, 2])
    assert len(objects(fusion)) == 1


def test_going_on_in_the_midst_of_the_evidence_is_as_if_never_broken(tmp_path: Path) -> None:
    sights = [ONE] * 12 + [TWO] * 7
    whole, half = new_fusion(settings(split_frames=5)), new_fusion(settings(split_frames=5))
    run(whole, sights)
    run(half, sights[:14])
    changed, pruned = half.changes()
    saved = checkpoint_of(half.submaps(), changed=changed, pruned=pruned, next_id=half.next_id)
    with MapWriter.create(tmp_path / "half.uppm", "{}", {}) as writer:
        writer.checkpoint(saved)
    reader = MapReader.open(tmp_path / "half.uppm")
    assert [s.apart for s in reader.submaps() if s.parts is not None] == [2]
    again = PanopticFusion(settings(split_frames=5), similarity())
    again.restore(reader.submaps(), reader, reader.next_id)
    run(again, sights[14:], first=14)
    assert len(boxes(again)) == 2
    for a, b in zip(whole.submaps(), again.submaps(), strict=True):
        assert (a.id, a.views, a.apart, a.descriptor, a.state) == (b.id, b.views, b.apart, b.descriptor, b.state)
        for name in ("coords", "distance", "weight", "color", "belonging"):
            np.testing.assert_array_equal(getattr(whole.blocks(a.id), name), getattr(again.blocks(b.id), name))


def test_a_map_of_before_there_were_parts_is_read(tmp_path: Path) -> None:
    path = tmp_path / "old.uppm"
    with MapWriter.create(path, "{}", {}) as writer:
        writer.checkpoint(checkpoint_of([submap_of(1)]))
    with MapWriter.resume(path) as writer:
        writer._db.execute("DROP TABLE parts")
        writer._db.execute("COMMIT")
        writer._db.execute("BEGIN")
    (submap,) = MapReader.open(path).submaps()
    assert (submap.apart, submap.parts) == (0, None)


def live() -> LiveSubmap:
    return LiveSubmap.of(submap_of(1), 0)


def test_evidence_counts_frames_less_those_against() -> None:
    left = np.array([[x, 0, 0] for x in range(-8, 0)], dtype=np.int32)
    right = np.array([[x, 0, 0] for x in range(8)], dtype=np.int32)
    submap = live()
    splitting.seen_as_one(submap, right)
    assert (submap.apart, len(submap.parts)) == (0, 0)
    for n, (one, other) in enumerate(((left, right), (right, left), (left[4:], right[:4])), start=1):
        splitting.seen_apart(submap, one, other)
        assert submap.apart == n
    # Whichever segment comes first, a cell's side is the same: its votes add up.
    assert sorted(np.abs(submap.parts[:, 3]).tolist()) == [2] * 8 + [3] * 8
    splitting.seen_as_one(submap, right)
    assert submap.apart == 3
    splitting.seen_as_one(submap, np.concatenate([left, right]))
    assert submap.apart == 2
    # Odd from even cells: another division.
    cells = np.concatenate([left, right])
    splitting.seen_apart(submap, cells[::2], cells[1::2])
    splitting.seen_apart(submap, cells[::2], cells[1::2])
    assert (submap.apart, len(submap.parts)) == (0, 0)


@pytest.mark.parametrize(("on", "rivals"), [([900, 700], [0, 1]), ([900, 200], [0]), ([500, 40], [0])])
def test_segments_that_lie_elsewhere_are_no_parts(on: list[int], rivals: list[int]) -> None:
    overlap = np.array([[0, *on], [0, 0, 300]])
    assert splitting.rivals(0, np.array([0, 0]), overlap, np.array([1000, 800])) == rivals
    assert splitting.rivals(1, np.array([0, 0]), overlap, np.array([1000, 800])) == []
    # The one that goes to the submap comes first, though it is the smaller.
    both = np.array([[0, 700, 900]])
    assert splitting.rivals(0, np.array([0, 7]), both, np.array([1000, 1000])) == [0, 1]
    assert splitting.rivals(0, np.array([7, 0]), both, np.array([1000, 1000])) == [1, 0]
