"""Fusion against analytic truth: a plane, a sphere, touching boxes, a thin board, and what labels do to submaps."""

from __future__ import annotations

import os

import numba
import numpy as np
import pytest

from tests.fusion.scenes import RING, TARGET, fuse, objects, similarity, vertices
from tests.scenes import Box, Plane, Sphere, described, look_at, render
from uppm._kernels.reference import voxel_centers
from uppm.core.categories import category_by_name
from uppm.core.config import FusionConfig
from uppm.core.types import SubmapKind, SubmapState
from uppm.fusion.engine import PanopticFusion


def test_plane_and_sphere_lie_where_they_are() -> None:
    fusion = fuse(
        [Plane([0, 0, 1], 0.0), Sphere([0, 0, 0.4], 0.3)], [("floor", "floor-other"), ("ball", "sports ball")]
    )
    floor, ball = objects(fusion)
    assert (floor.kind, ball.kind) == (SubmapKind.BACKGROUND, SubmapKind.OBJECT)
    assert (floor.voxel_size, ball.voxel_size) == (0.05, 0.02)
    height = vertices(fusion, floor)[:, 2]
    assert len(height) > 500
    assert np.quantile(np.abs(height), 0.95) < 0.1 * floor.voxel_size
    off = np.linalg.norm(vertices(fusion, ball) - [0, 0, 0.4], axis=1) - 0.3
    assert np.abs(off).mean() < 0.1 * ball.voxel_size
    assert np.abs(off).max() < 1.0 * ball.voxel_size
    np.testing.assert_allclose(ball.center, [0, 0, 0.4], atol=0.05)


def test_touching_boxes_do_not_leak_across_the_contact() -> None:
    left, right = Box([-0.4, -0.2, 0], [0.0, 0.2, 0.4]), Box([0.0, -0.2, 0], [0.4, 0.2, 0.4])
    fusion = fuse([left, right], [("box a", "suitcase"), ("box b", "refrigerator")])
    a, b = objects(fusion)
    for submap, share in ((a, -1), (b, 1)):
        across = vertices(fusion, submap)[:, 0] * -share
        assert len(across) > 200
        assert across.max() <= submap.voxel_size
    assert a.voxel_size != b.voxel_size


def test_a_thin_board_keeps_both_sides() -> None:
    board = Box([-0.5, -0.04, 0.0], [0.5, 0.04, 0.8])
    fusion = fuse([board], [("board", "surfboard")], config=FusionConfig(max_blocks=20000, voxel_size=0.02))
    (submap,) = objects(fusion)
    y = vertices(fusion, submap)[:, 1]
    for side in (-0.04, 0.04):
        near = y[np.abs(y - side) < 0.03]
        assert len(near) > 300
        assert np.abs(near - side).mean() < 0.006


def test_freespace_is_carved_and_never_an_object() -> None:
    fusion = fuse([Plane([0, 0, 1], 0.0)], [("floor", "floor-other")])
    (free,) = [s for s in fusion.submaps() if s.kind is SubmapKind.FREESPACE]
    assert free.voxel_size == pytest.approx(0.3)
    blocks = fusion.blocks(free.id)
    height = voxel_centers(blocks.coords, free.voxel_size)[..., 2]
    above, below = (blocks.weight > 0) & (height > 0.3), (blocks.weight > 0) & (height < -0.3)
    assert above.sum() > 150
    assert (blocks.distance[above] > 0).all()
    assert (blocks.distance[below] < 0).all()


def test_table_and_dining_table_end_as_one_submap() -> None:
    table = Box([-0.5, -0.4, 0.0], [0.5, 0.4, 0.5])
    fusion = PanopticFusion(FusionConfig(max_blocks=20000), similarity(table__dining_table=0.8))
    names = ["table"] * 3 + ["dining table"] * 7 + ["table"] * 2
    for n, (eye, name) in enumerate(zip(RING, names, strict=True)):
        frame, ids = render([table], look_at(eye, TARGET), n)
        fusion.fuse(frame, described(ids, [(name, "dining table" if name == "dining table" else "table")]))
    fusion.finish()
    things = objects(fusion)
    assert len(things) == 1
    descriptor = things[0].descriptor
    assert descriptor is not None
    assert descriptor.category == category_by_name()["dining table"]
    assert {r.text: r.count for r in descriptor.labels} == {"dining table": 7, "table": 5}
    # COCO-Stuff has `table` as stuff, `dining table` as a thing.
    assert things[0].kind is SubmapKind.OBJECT
    assert (things[0].views, things[0].voxel_size) == (12, 0.05)


def test_policy_same_keeps_categories_apart() -> None:
    ball = Sphere([0, 0, 0.4], 0.3)
    config = FusionConfig(max_blocks=20000, category_policy="same")
    fusion = PanopticFusion(config, similarity(apple__orange=0.9))
    for n, eye in enumerate(RING[:4]):
        frame, ids = render([ball], look_at(eye, TARGET), n)
        name = ("apple", "orange")[n % 2]
        fusion.fuse(frame, described(ids, [(name, name)]))
    assert [s.views for s in objects(fusion)] == [2, 2]


def test_a_wrong_name_on_the_same_surface_is_another_word_for_it() -> None:
    ball, wrong = Sphere([0, 0, 0.4], 0.3), {2, 5}
    for certain, one in ((0.5, True), (1.0, False)):
        fusion = PanopticFusion(FusionConfig(max_blocks=20000, certain_iou=certain), similarity())
        for n, eye in enumerate(RING[:8]):
            frame, ids = render([ball], look_at(eye, TARGET), n)
            name = "clock" if n in wrong else "orange"
            fusion.fuse(frame, described(ids, [(name, name)]))
        things = objects(fusion)
        assert (len(things) == 1) is one
        assert things[0].descriptor is not None
        assert things[0].descriptor.category.name == "orange"


def test_a_category_of_another_size_resamples_after_enough_views() -> None:
    fusion = PanopticFusion(FusionConfig(max_blocks=20000), similarity(cup__couch=0.8))
    ball = Sphere([0, 0, 0.4], 0.3)
    sizes = []
    for n, eye in enumerate(RING):
        frame, ids = render([ball], look_at(eye, TARGET), n)
        name = "cup" if n == 0 else "couch"
        fusion.fuse(frame, described(ids, [(name, name)]))
        sizes.append(objects(fusion)[0].voxel_size)
    assert sizes[:2] == [0.02, 0.02]
    assert sizes[-1] == 0.05
    (submap,) = objects(fusion)
    off = np.linalg.norm(vertices(fusion, submap) - [0, 0, 0.4], axis=1) - 0.3
    assert np.abs(off).mean() < 0.15 * submap.voxel_size


def test_tentative_submaps_go_when_they_are_not_seen_again() -> None:
    scene = [Plane([0, 0, 1], 0.0), Sphere([0, 0, 0.4], 0.3)]
    fusion = PanopticFusion(FusionConfig(max_blocks=20000, max_misses=2), similarity())
    for n in range(5):
        frame, ids = render(scene, look_at(RING[0], TARGET), n)
        shown = ids if n == 0 else np.where(ids == 2, 0, ids).astype(np.int32)
        fusion.fuse(frame, described(shown, [("floor", "floor-other"), ("ball", "sports ball")], score=0.5))
    states = {s.descriptor.category.name: s.state for s in objects(fusion) if s.descriptor}
    assert states == {"floor-other": SubmapState.CONFIRMED}
    assert fusion.dropped["tentative submap not seen again"] == 1


def test_what_no_segment_covers_is_unlabeled_background() -> None:
    scene = [Plane([0, 0, 1], 0.0), Sphere([0, 0, 0.4], 0.3)]
    fusion = PanopticFusion(FusionConfig(max_blocks=20000), similarity())
    for n, eye in enumerate(RING):
        frame, ids = render(scene, look_at(eye, TARGET), n)
        ids = np.where(ids == 1, 0, ids) if n % 2 else np.zeros_like(ids)
        fusion.fuse(frame, described(np.minimum(ids, 1).astype(np.int32), [("ball", "sports ball")]))
    fusion.finish()
    (rest,) = [s for s in fusion.submaps() if s.descriptor is None and s.kind is SubmapKind.BACKGROUND]
    z = vertices(fusion, rest)[:, 2]
    # The floor is there; the ball, labeled in half of the frames, is its own submap's alone.
    assert (np.abs(z) < 0.03).mean() > 0.97
    assert len(objects(fusion)) == 1


def test_results_do_not_depend_on_threads() -> None:
    scene = [Plane([0, 0, 1], 0.0), Sphere([0, 0, 0.4], 0.3), Box([0.3, 0.3, 0], [0.6, 0.7, 0.5])]
    names = [("floor", "floor-other"), ("ball", "sports ball"), ("box", "suitcase")]
    used, results = [], []
    for threads in (1, 2):
        results.append(fuse(scene, names, RING[:6], FusionConfig(max_blocks=20000, threads=threads)))
        used.append(numba.get_num_threads())
    assert used == [1, min(2, os.cpu_count() or 1)]
    one, two = results
    for a, b in zip(one.submaps(), two.submaps(), strict=True):
        x, y = one.blocks(a.id), two.blocks(b.id)
        for name in ("coords", "distance", "weight", "color", "belonging"):
            np.testing.assert_array_equal(getattr(x, name), getattr(y, name))
        assert a.views == b.views


def test_restored_fusion_goes_on_as_if_never_broken() -> None:
    scene, names = (
        [Plane([0, 0, 1], 0.0), Sphere([0, 0, 0.4], 0.3)],
        [("floor", "floor-other"), ("ball", "sports ball")],
    )
    whole = fuse(scene, names)
    half = fuse(scene, names, RING[:5])
    again = PanopticFusion(FusionConfig(max_blocks=20000), similarity())
    again.restore(half.submaps(), half, half.next_id)
    for n, eye in enumerate(RING[5:], start=5):
        frame, ids = render(scene, look_at(eye, TARGET), n)
        again.fuse(frame, described(ids, names))
    for a, b in zip(whole.submaps(), again.submaps(), strict=True):
        assert (a.id, a.views, a.descriptor, a.state, a.evidence) == (b.id, b.views, b.descriptor, b.state, b.evidence)
        np.testing.assert_array_equal(whole.blocks(a.id).distance, again.blocks(b.id).distance)
        np.testing.assert_array_equal(whole.blocks(a.id).weight, again.blocks(b.id).weight)
