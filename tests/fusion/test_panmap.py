"""The rules of Panoptic Multi-TSDFs, each switched by a setting of its own (docs/configuration.md)."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fusion.scenes import RING, new_fusion, objects, see, settings, vertices
from tests.scenes import CAMERA, Box, Plane, Sphere
from uppm.core.config import FusionConfig
from uppm.core.types import Intrinsics, Submap, SubmapState
from uppm.fusion.engine import PanopticFusion
from uppm.fusion.lifecycle import min_pixels
from uppm.fusion.tracking import NEW, assign, assign_greedily

BALL, FLOOR = Sphere([0, 0, 0.4], 0.3), Plane([0, 0, 1], 0.0)
BALL_NAME, FLOOR_NAME = ("ball", "sports ball"), ("floor", "floor-other")
PANMAP = settings("panmap", min_pixels=0)


def ball(fusion: PanopticFusion) -> Submap:
    (found,) = [s for s in objects(fusion) if s.descriptor and s.descriptor.category.name == "sports ball"]
    return found


def test_greedy_takes_the_best_for_each_segment_though_it_is_taken() -> None:
    iou, least = np.array([[0.6, 0.55, 0.05], [0.5, 0.1, 0.0]]), np.full((2, 3), 0.1)
    np.testing.assert_array_equal(assign_greedily(iou, least), [0, 0, NEW])
    np.testing.assert_array_equal(assign(iou, least), [1, 0, NEW])
    least[0] = np.inf
    np.testing.assert_array_equal(assign_greedily(iou, least), [1, 1, NEW])
    np.testing.assert_array_equal(assign_greedily(np.empty((0, 2)), np.empty((0, 2))), [NEW, NEW])


def test_a_fixed_pixel_minimum_scales_with_the_image() -> None:
    whole = Intrinsics(fx=320, fy=320, cx=320, cy=240, width=640, height=480)
    half = Intrinsics(fx=160, fy=160, cx=160, cy=120, width=320, height=240)
    config = settings("panmap")
    assert [min_pixels(size, depth, whole, config) for size in (0.02, 0.05) for depth in (1.0, 3.0)] == [2000] * 4
    assert min_pixels(0.02, 1.0, half, config) == 500
    assert min_pixels(0.02, 1.0, whole, settings()) == np.ceil(8 * 0.02**2 * 320 * 320)


@pytest.mark.parametrize(("pixels", "founded"), [(500, 1), (40000, 0)])
def test_a_segment_of_fewer_pixels_founds_no_submap(pixels: int, founded: int) -> None:
    fusion = new_fusion(settings("panmap", min_pixels=pixels))
    see(fusion, [BALL], [BALL_NAME], 0)
    assert len(objects(fusion)) == founded
    assert fusion.dropped["segment too small to found a submap"] == 1 - founded


@pytest.mark.parametrize(("votes", "category"), [("first", "cup"), ("count", "vase"), ("weighted", "vase")])
def test_votes_of_the_first_label_or_of_all(votes: str, category: str) -> None:
    fusion = new_fusion(settings(votes=votes, category_policy="any"))
    for n, name in enumerate(("cup", "vase", "vase")):
        see(fusion, [BALL], [(name, name)], n)
    (submap,) = objects(fusion)
    assert submap.descriptor is not None
    assert submap.descriptor.category.name == category
    assert {r.text: r.count for r in submap.descriptor.labels} == {"cup": 1, "vase": 2}


@pytest.mark.parametrize(("resample", "size"), [(False, 0.02), (True, 0.05)])
def test_voxels_follow_the_category_or_stay(resample: bool, size: float) -> None:
    fusion = new_fusion(settings(resample=resample), cup__couch=0.8)
    for n, name in enumerate(("cup", *["couch"] * 6)):
        see(fusion, [BALL], [(name, name)], n)
    (submap,) = objects(fusion)
    assert submap.descriptor is not None
    assert (submap.descriptor.category.name, submap.voxel_size) == ("couch", size)


def test_a_new_submap_is_seen_in_each_of_the_next_frames_or_deleted() -> None:
    fusion, states = new_fusion(PANMAP), []
    for n in range(6):
        see(fusion, [BALL], [BALL_NAME], n)
        states.append(ball(fusion).state)
    assert states == [SubmapState.TENTATIVE] * 5 + [SubmapState.CONFIRMED]
    again = new_fusion(PANMAP)
    for n in range(5):
        see(again, [BALL], [BALL_NAME], n)
    see(again, [BALL], [BALL_NAME], 5, segments=[0])
    assert objects(again) == []
    assert again.dropped["tentative submap not seen again"] == 1


def test_five_frames_without_a_submap_make_it_inactive_in_view_or_not() -> None:
    fusion, states = new_fusion(PANMAP), []
    for n in range(6):
        see(fusion, [BALL], [BALL_NAME], n)
    for n in range(6, 11):
        see(fusion, [FLOOR], [FLOOR_NAME], n, eye=[0.0, 6.0, 1.0])
        states.append(ball(fusion).state)
    assert states == [SubmapState.CONFIRMED] * 4 + [SubmapState.INACTIVE]


def come_back(config: FusionConfig) -> list[int]:
    """Number of balls after each frame: seen six times, hidden for five, seen six times, hidden for five."""
    fusion, counts = new_fusion(config), []
    for n in range(22):
        see(fusion, [BALL], [BALL_NAME], n, segments=[int(n % 11 < 6)])
        counts.append(len(objects(fusion)))
    return counts


def test_an_object_that_comes_back_is_new_until_both_are_inactive() -> None:
    # The frame in which the second becomes inactive merges it with the first.
    assert come_back(PANMAP) == [1] * 11 + [2] * 10 + [1]
    assert come_back(settings("panmap", min_pixels=0, merge_deactivated="none"))[-1] == 2
    assert come_back(settings("panmap", min_pixels=0, track_inactive=True)) == [1] * 22


def test_what_conflicts_or_has_another_category_is_not_merged() -> None:
    # Half a ball's width apart: much of either surface lies deep inside the other, and a little of it beside.
    for shift, name, left in ((0.0, BALL_NAME, 1), (0.15, BALL_NAME, 2), (0.0, ("vase", "vase"), 2)):
        fusion = new_fusion(PANMAP)
        for n in range(6):
            see(fusion, [BALL], [BALL_NAME], n)
        for n in range(6, 11):
            see(fusion, [FLOOR], [FLOOR_NAME], n, eye=[0.0, 6.0, 1.0])
        for n in range(12, 18):
            see(fusion, [Sphere([shift, 0, 0.4], 0.3)], [name], n)
        fusion.finish()
        assert len([s for s in objects(fusion) if s.descriptor and s.descriptor.category.is_thing]) == left, (
            shift,
            name,
        )


@pytest.mark.parametrize(("update", "changes"), [("view", True), ("tracked", False)])
def test_submaps_in_view_or_with_a_segment_are_updated(update: str, changes: bool) -> None:
    fusion = new_fusion(settings(update=update))
    for n in range(2):
        see(fusion, [FLOOR, BALL], [FLOOR_NAME, BALL_NAME], n)
    before = fusion.blocks(ball(fusion).id).weight
    see(fusion, [FLOOR, BALL], [FLOOR_NAME], 2, segments=[1, 0])
    after = fusion.blocks(ball(fusion).id).weight
    assert (after.sum() > before.sum()) == changes


def test_all_blocks_in_view_are_updated_or_those_with_a_surface() -> None:
    observed = {}
    for update in ("view", "surface"):
        fusion = new_fusion(settings(update=update))
        see(fusion, [FLOOR, BALL], [FLOOR_NAME, BALL_NAME], 0)
        for n in range(1, 4):
            see(fusion, [FLOOR, BALL], [FLOOR_NAME], n, segments=[1, 0])
        observed[update] = fusion.blocks(ball(fusion).id).weight.sum()
    assert observed["view"] > 1.02 * observed["surface"]


def test_distance_is_along_the_ray_or_the_normal() -> None:
    eye = [-2.0, 0.0, 1.0]
    for distance, factor in (("normal", 1.0), ("ray", np.sqrt(5.0))):
        fusion = new_fusion(settings(distance=distance))
        see(fusion, [FLOOR], [FLOOR_NAME], 0, eye=eye)
        (floor,) = objects(fusion)
        blocks = fusion.blocks(floor.id)
        grid = np.moveaxis(np.indices((8, 8, 8)), 0, -1)
        at = (blocks.coords[:, None, None, None] * 8 + grid + 0.5) * floor.voxel_size
        # Along the camera's axis, which meets the floor at an angle whose sine is 1 / sqrt(5).
        near = (np.abs(at[..., 1]) < 0.1) & (np.abs(at[..., 0]) < 0.1) & (at[..., 2] > 0) & (blocks.weight > 0)
        measured = blocks.distance[near] / 32767 * floor.truncation
        within = measured < 0.99 * floor.truncation
        assert within.sum() > 8
        np.testing.assert_allclose(np.median(measured[within] / at[..., 2][near][within]), factor, rtol=0.12)


def test_belonging_by_majority_or_by_one_sight() -> None:
    left, right = Box([-0.4, -0.2, 0], [0.0, 0.2, 0.4]), Box([0.0, -0.2, 0], [0.4, 0.2, 0.4])
    names = [("a", "suitcase"), ("b", "refrigerator")]
    across = {}
    for belonging in ("majority", "once"):
        fusion = new_fusion(settings(belonging=belonging, certain_iou=1.0))
        for n in range(8):
            # One mask in eight leaks over the other box.
            see(fusion, [left, right], names, n, eye=[0.3, -1.7, 1.1], segments=[1, 1] if n == 4 else [1, 2])
        a = next(s for s in objects(fusion) if s.descriptor and s.descriptor.category.name == "suitcase")
        across[belonging] = vertices(fusion, a)[:, 0].max()
    assert across["majority"] <= 0.03
    assert across["once"] > 0.2


def test_range_between_pixels_is_interpolated_or_not() -> None:
    off = {}
    for interpolation in ("bilinear", "nearest"):
        fusion = new_fusion(settings(interpolation=interpolation, voxel_size=0.02))
        for n in range(len(RING)):
            see(fusion, [BALL], [BALL_NAME], n)
        radius = np.linalg.norm(vertices(fusion, ball(fusion)) - [0, 0, 0.4], axis=1)
        off[interpolation] = np.abs(radius - 0.3).mean()
    assert off["bilinear"] < 0.9 * off["nearest"]
    assert CAMERA.width == 160
