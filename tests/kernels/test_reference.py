"""Each kernel against its NumPy reference, on an analytic scene seen from several places."""

from __future__ import annotations

import numpy as np
import pytest

from tests.scenes import CAMERA, Box, Plane, Sphere, look_at, render
from uppm._kernels import reference
from uppm._kernels.camera import TILE
from uppm.core.geometry import invert
from uppm.core.geometry import rays as make_rays
from uppm.fusion.view import View, ViewFactory
from uppm.fusion.volume import Volume

# Off the grid, where rounding would decide the voxel of a point.
SHAPES = [Plane([0, 0, 1], 0.013), Sphere([0.1, 0.0, 0.3], 0.3), Box([0.507, -0.404, 0.0], [0.807, 0.106, 0.506])]
SIZES = (0.05, 0.03, 0.02)
EYES = ([-1.6, 0.3, 1.1], [-1.2, -1.0, 0.9], [0.2, -1.7, 1.3])
T_MAP_SUBMAP = np.array([[0.8, -0.6, 0, 0.3], [0.6, 0.8, 0, -0.2], [0, 0, 1, 0.1], [0, 0, 0, 1.0]])
RAYS = make_rays(CAMERA)


def place(volume: Volume, view: View, slot_image: np.ndarray) -> np.ndarray:
    """Allocate for an image of slots; returns the new blocks."""
    slots = np.arange(-1, slot_image.max() + 1, dtype=np.int32)
    placed = volume.place(view, slot_image + np.int32(1), slots, slots + np.int32(1), slots[1:])
    np.testing.assert_array_equal(placed.slot_image, slot_image)
    np.testing.assert_array_equal(placed.id_image, slot_image + 1)
    for slot in slots[1:]:
        down, across = np.nonzero(slot_image == slot)
        tiles = np.zeros(placed.present.shape[:2], dtype=bool)
        tiles[down // TILE, across // TILE] = True
        np.testing.assert_array_equal(placed.present[..., placed.rows[slot]], tiles)
    return placed.new


class Fused:
    """Three submaps after some frames, by the kernels and by the references."""

    def __init__(self, noise_growth: int = 2) -> None:
        self.noise_growth = noise_growth
        self.volume = Volume(20000, 1e4, 0.2, noise_growth)
        poses = [np.eye(4), T_MAP_SUBMAP, np.eye(4)]
        self.slots = np.array([self.volume.add(s, 2 * s, T, False) for s, T in zip(SIZES, poses, strict=True)])
        self.slots = self.slots.astype(np.int32)
        self.poses, self.factory = poses, ViewFactory(0.1, 5.0)
        self.voxels: list[dict] = [{}, {}, {}]
        self.coords: list[np.ndarray] = [np.empty((0, 3), np.int32)] * 3

    def frame(self, eye: list[float]):
        frame, ids = render(SHAPES, look_at(eye, [0.3, 0.0, 0.2]))
        rng = np.random.default_rng(3)
        depth = np.where(rng.random(frame.depth.shape) < 0.03, 0, frame.depth).astype(np.float32)
        object.__setattr__(frame, "depth", depth)
        return frame, ids, np.array([-1, *self.slots], dtype=np.int32)[ids]

    def state(self, n: int) -> tuple[np.ndarray, dict]:
        blocks = self.volume.gather(self.volume.indices(int(self.slots[n])))
        names = "distance", "weight", "color", "belonging"
        return blocks.coords, {name: getattr(blocks, name) for name in names}

    def integrate(self, eye: list[float]) -> None:
        frame, _, slot_image = self.frame(eye)
        view = self.factory.view(frame)
        visible = self.volume.visible(view, self.slots).blocks
        new = place(self.volume, view, slot_image)
        before = [self.state(n) for n in range(3)]
        touched = np.unique(np.concatenate([visible, new]))
        self.volume.integrate(view, touched, slot_image)
        images = {"range": view.range_image, "cosine": view.cosine, "slot": slot_image, "color": frame.color}
        pool = self.volume.pool
        for n, (coords, voxels) in enumerate(before):
            seen = {tuple(c) for c in pool.block_coord[touched[pool.block_slot[touched] == self.slots[n]]].tolist()}
            expected = reference.integrate(
                coords, voxels, images, tuple(map(float, view.camera)), view.T_camera_map @ self.poses[n],
                SIZES[n], 2 * SIZES[n], int(self.slots[n]), 0.2, 1e4, self.noise_growth,
            )  # fmt: skip
            self.compare(n, np.array([tuple(c) in seen for c in coords.tolist()]), voxels, expected)

    def compare(self, n: int, touched: np.ndarray, before: dict, expected: dict) -> None:
        _, got = self.state(n)
        wrong = np.abs(got["distance"].astype(int) - expected["distance"]) > 40
        # Single against double precision decides a handful of voxels at thresholds and pixel borders differently.
        assert wrong[touched].mean() < 2e-3
        assert np.isclose(got["weight"], expected["weight"], rtol=1e-3)[touched].mean() > 0.998
        assert (got["belonging"] == expected["belonging"])[touched].mean() > 0.998
        assert (np.abs(got["color"].astype(int) - expected["color"]) <= 1)[touched].mean() > 0.998
        # A block that is not listed as visible must be one that the frame cannot change.
        out = ~touched & ~(np.abs(before["distance"]) == 32767).all(axis=(1, 2, 3))
        free = expected["distance"][out] == 32767
        same = (expected["weight"] == before["weight"])[out] | free
        # Rays that meet a surface at a slant reach a little further behind it than the list looks.
        assert not out.any() or same.mean() > 0.99


@pytest.fixture(scope="module")
def fused() -> Fused:
    scene = Fused()
    for eye in EYES:
        scene.integrate(eye)
    return scene


def test_integrate_agrees(fused: Fused) -> None:
    assert fused.volume.pool.used > 100
    for n in range(3):
        coords, voxels = fused.state(n)
        assert len(coords) > 5
        assert (voxels["weight"] > 0).mean() > 0.1


@pytest.mark.parametrize("noise_growth", [0, 1])
def test_weights_follow_the_noise(noise_growth: int) -> None:
    scene = Fused(noise_growth)
    for eye in EYES[:2]:
        scene.integrate(eye)
    weight = scene.state(0)[1]["weight"]
    if noise_growth == 0:
        # In front of the band's end, every measurement counts alike, near or far.
        one = np.float32(CAMERA.fx * CAMERA.fy * SIZES[0] ** 2)
        assert np.isin(np.round(weight[weight > 0] / one, 3), (1.0, 2.0)).mean() > 0.5


def test_allocation_covers_the_band_and_little_more(fused: Fused) -> None:
    frame, _, slot_image = fused.frame(EYES[0])
    view = fused.factory.view(frame)
    for n, size in enumerate(SIZES):
        mine = np.where(slot_image == fused.slots[n], view.range_image, 0)
        T_submap_camera = invert(view.T_camera_map @ fused.poses[n])
        needed = reference.band_block_coords(mine, RAYS, T_submap_camera, 2 * size, 8 * size)
        volume = Volume(20000, 1e4, 0.2)
        slot = volume.add(size, 2 * size, fused.poses[n], False)
        place(volume, view, np.where(slot_image == fused.slots[n], slot, -1).astype(np.int32))
        got = {tuple(c) for c in volume.pool.block_coord[volume.indices(slot)].tolist()}
        missing = needed - got
        assert len(missing) <= 0.01 * len(needed)
        assert len(got) <= 1.6 * len(needed)


def test_incidence_agrees(fused: Fused) -> None:
    frame, _, _ = fused.frame(EYES[0])
    view = fused.factory.view(frame)
    expected = reference.ray_cosine(view.depth, RAYS, 0.2)
    close = np.abs(view.cosine - expected) < 0.02
    # Seen in perspective the two tangents are chords: they part a little where the surface is curved or jumps.
    assert close.mean() > 0.97
    assert expected.min() < 0.6


def test_prepared_depth_agrees(fused: Fused) -> None:
    frame, _, _ = fused.frame(EYES[1])
    view = ViewFactory(0.5, 2.0).view(frame)
    depth, ranges = reference.prepare_depth(frame.depth, np.linalg.norm(RAYS, axis=2), 0.5, 2.0)
    np.testing.assert_array_equal(view.depth, depth)
    np.testing.assert_allclose(view.range_image, ranges, rtol=1e-6)
    assert view.tile_max[2, 3] == depth[32:48, 48:64].max()


def test_overlap_expectation_and_rendering_agree(fused: Fused) -> None:
    frame, ids, _ = fused.frame(EYES[2])
    view = fused.factory.view(frame)
    visible = fused.volume.visible(view, fused.slots)
    overlap, pixels, depth = fused.volume.overlap(view, visible, fused.slots, ids, 3)
    measured = reference.segment_pixels(ids, view.depth, 3)
    np.testing.assert_array_equal(pixels, measured[0])
    np.testing.assert_allclose(depth, measured[1] / np.maximum(measured[0], 1))
    expected = fused.volume.expected(view, visible.blocks, fused.slots)
    distances: list[np.ndarray] = []
    for n, size in enumerate(SIZES):
        T = view.T_camera_map @ fused.poses[n]
        coords, voxels = fused.state(n)
        distance = reference.surface_distance(coords, voxels, view.depth, RAYS, invert(T), size, 2 * size)
        counts = np.bincount(ids[np.isfinite(distance)], minlength=4)
        distances.append(distance)
        assert counts.sum() > 100
        np.testing.assert_allclose(overlap[n], counts, atol=max(5, 0.01 * counts.sum()))
        camera = tuple(map(float, view.camera))
        agree, through = reference.count_expected(coords, voxels, view.depth, camera, T, size, 2 * size)
        np.testing.assert_allclose(expected[n], (agree, through), atol=max(4, 0.02 * agree))
    nearest = np.where(np.isfinite(distances).any(axis=0), np.argmin(distances, axis=0) + 1, 0)
    rendered = fused.volume.rendered(view, visible, fused.slots)
    assert (rendered == nearest).mean() > 0.995
    assert set(np.unique(rendered)) == {0, 1, 2, 3}
