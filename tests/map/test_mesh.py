"""Meshes against analytic truth."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import KDTree
from skimage.measure import marching_cubes

from tests.map.scenes import blocks_of, box, plane, sphere, submap_of
from uppm.core.geometry import invert, transform
from uppm.core.types import Mesh, VoxelBlocks
from uppm.map.mesh import merged, submap_mesh


def boundary_edges(mesh: Mesh) -> np.ndarray:
    """Edges (E, 2) that only one face has."""
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    assert counts.max() <= 2, "an edge with more than two faces"
    return unique[counts == 1]


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(np.float64) for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def face_normals(mesh: Mesh) -> np.ndarray:
    """The faces' normals around each vertex (V, 3), weighted by area."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(np.float64) for i in range(3))
    face = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    normals = np.zeros(mesh.vertices.shape)
    np.add.at(normals, mesh.faces.ravel(), face)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Degrees between unit vectors (N, 3)."""
    return np.degrees(np.arccos(np.einsum("ij,ij->i", a, b).clip(-1, 1)))


@pytest.mark.parametrize("center", [(0.0, 0.0, 0.0), (0.013, -0.021, 0.007)])
def test_sphere_is_closed_and_where_it_should_be(center: tuple[float, float, float]) -> None:
    radius, voxel = 0.9, 0.02
    submap = submap_of(1, voxel=voxel)
    mesh = submap_mesh(submap, blocks_of(sphere(center, radius), (-1, -1, -1), (1, 1, 1), voxel))
    local = transform(invert(submap.T_map_submap), mesh.vertices) - center
    error = np.abs(np.linalg.norm(local, axis=1) - radius)
    assert error.max() < 0.02 * voxel
    assert len(boundary_edges(mesh)) == 0
    outward = local / np.linalg.norm(local, axis=1, keepdims=True)
    # Of the distance's gradient; the faces' mean would be half as far off again.
    angle, of_faces = (angles(outward, normals) for normals in (mesh.normals, face_normals(mesh)))
    assert angle.max() < 0.6
    assert angle.mean() < 0.7 * of_faces.mean()
    moved = dataclasses.replace(mesh, vertices=local.astype(np.float32))
    assert volume(moved) == pytest.approx(4 / 3 * np.pi * radius**3, rel=2e-3)


def test_plane_over_many_blocks_has_edges_only_at_its_rim() -> None:
    voxel = 0.05
    submap = submap_of(1, voxel=voxel)
    mesh = submap_mesh(submap, blocks_of(plane((0, 0, 1), 0.1), (-6, -6, -1), (6, 6, 1), voxel))
    local = transform(invert(submap.T_map_submap), mesh.vertices)
    rim = local[boundary_edges(mesh)].mean(axis=1)
    assert len(rim) > 0
    assert (np.abs(rim[:, :2]).max(axis=1) > 6 - 1.1 * voxel).all()
    np.testing.assert_allclose(local[:, 2], 0.1, atol=1e-5)


def test_slanted_plane_crosses_tiles_without_cracks() -> None:
    voxel, low, high = 0.03, (-2.4, -2.4, -4), (2.4, 2.4, 4)
    submap = submap_of(1, voxel=voxel)
    mesh = submap_mesh(submap, blocks_of(plane((0.3, -0.7, 1), 0.0), low, high, voxel))
    local = transform(invert(submap.T_map_submap), mesh.vertices)
    rim = local[boundary_edges(mesh)].reshape(-1, 3)
    assert (np.abs(rim[:, :2]).max(axis=1) > 2.35).all()


def marching(shape: Callable[[np.ndarray], np.ndarray], voxel: float, half: int) -> Mesh:
    """scikit-image's marching cubes of the same field, on voxels [-half, half), frame submap."""
    axis = (np.arange(-half, half) + 0.5) * voxel
    field = shape(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1))
    vertices, faces, normals, _ = marching_cubes(np.clip(field, -2 * voxel, 2 * voxel), 0.0)
    placed = ((vertices - half + 0.5) * voxel).astype(np.float32)
    return Mesh(vertices=placed, normals=normals, colors=np.zeros(placed.shape, np.uint8), faces=faces.astype(np.int32))


def test_creases_are_sharper_than_marching_cubes() -> None:
    voxel, low, high = 0.05, np.array([0.01, -0.32, 0.13]), np.array([0.42, 0.17, 0.61])
    submap, shape = submap_of(1, voxel=voxel), box(low.tolist(), high.tolist())
    mesh = submap_mesh(submap, blocks_of(shape, (-0.6,) * 3, (1.0,) * 3, voxel))
    local = transform(invert(submap.T_map_submap), mesh.vertices)
    assert len(boundary_edges(mesh)) == 0
    assert np.abs(shape(local)).max() < 0.17 * voxel
    ours, theirs = dataclasses.replace(mesh, vertices=local.astype(np.float32)), marching(shape, voxel, 20)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T
    off = [KDTree(m.vertices).query(corners)[0].mean() for m in (ours, theirs)]
    lost = [abs(volume(m) - np.prod(high - low)) for m in (ours, theirs)]
    assert off[0] < 0.4 * off[1]
    assert lost[0] < 0.4 * lost[1]


def test_agrees_with_marching_cubes_of_scikit_image() -> None:
    voxel, shape, submap = 0.02, sphere((0.02, -0.01, 0.03), 0.4), submap_of(1, voxel=0.02)
    mesh = submap_mesh(submap, blocks_of(shape, (-0.64,) * 3, (0.64,) * 3, voxel))
    local, theirs = transform(invert(submap.T_map_submap), mesh.vertices), marching(shape, voxel, 32)
    ours_off, theirs_off = KDTree(theirs.vertices).query(local)[0], KDTree(local).query(theirs.vertices)[0]
    # Vertices lie on edges there and in cells here, so that the nearest is up to half a cell's diagonal away.
    assert max(ours_off.max(), theirs_off.max()) < 0.9 * voxel
    assert np.abs(shape(local)).max() < 0.02 * voxel
    assert np.abs(shape(theirs.vertices.astype(np.float64))).max() < 0.02 * voxel
    for m in (mesh, theirs):
        assert len(boundary_edges(m)) == 0
        assert len(m.vertices) - len(m.faces) // 2 == 2  # Euler's number of a sphere


@pytest.mark.parametrize("seed", range(4))
def test_every_edge_has_two_faces_or_ends_at_what_was_not_seen(seed: int) -> None:
    """Noisy weights and distances over many blocks: no crack at any block's border."""
    voxel, rng = 0.05, np.random.default_rng(seed)
    center = rng.uniform(-0.2, 0.2, 3)
    blocks = blocks_of(sphere(center.tolist(), 0.8), (-1.3,) * 3, (1.3,) * 3, voxel, seed=seed)
    noisy = blocks.distance + rng.normal(0, 0.02 * 32767, blocks.distance.shape)
    weight = np.where(rng.random(blocks.weight.shape) < 0.003, 0, blocks.weight).astype(np.float32)
    noisy = np.clip(np.rint(noisy), -32767, 32767).astype(np.int16)
    blocks = dataclasses.replace(blocks, distance=noisy, weight=weight)
    submap = submap_of(1, voxel=voxel)
    mesh = submap_mesh(submap, blocks)
    local = transform(invert(submap.T_map_submap), mesh.vertices) / voxel - 0.5
    voxels = (8 * blocks.coords[:, None, None, None] + np.moveaxis(np.indices((8, 8, 8)), 0, -1)).reshape(-1, 3)
    holes = voxels[(weight == 0).ravel()]
    rim = local[boundary_edges(mesh)].mean(axis=1)
    assert 0 < len(rim) < 0.2 * len(mesh.faces)
    assert KDTree(holes).query(rim)[0].max() < 2.2


def test_touching_boxes_of_two_submaps_stay_two_closed_surfaces() -> None:
    voxel = 0.02
    submap = submap_of(1, voxel=voxel)
    boxes = [box((0, 0, 0), (0.3, 0.2, 0.25)), box((0.3, 0, 0), (0.5, 0.2, 0.25))]
    meshes = [submap_mesh(submap, blocks_of(b, (-0.2, -0.2, -0.2), (0.8, 0.5, 0.5), voxel)) for b in boxes]
    for mesh, expected in zip(meshes, (0.3, 0.2), strict=True):
        assert len(boundary_edges(mesh)) == 0
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0)[0], expected, atol=0.2 * voxel)
    both = merged(meshes)
    assert len(both.faces) == sum(len(m.faces) for m in meshes)
    assert volume(both) == pytest.approx(0.5 * 0.2 * 0.25, rel=0.05)


def test_only_the_part_that_belongs_is_meshed() -> None:
    voxel = 0.05
    blocks = blocks_of(plane((0, 0, 1), 0.1), (-2, -2, -1), (2, 2, 1), voxel)
    belonging = np.zeros_like(blocks.belonging)
    x = (8 * blocks.coords[:, 0, None] + np.arange(8) + 0.5) * voxel
    belonging[..., 0] = 1
    belonging[..., 1] = 2 * (x > 0)[:, :, None, None]
    submap = submap_of(1, voxel=voxel)
    mesh = submap_mesh(submap, dataclasses.replace(blocks, belonging=belonging))
    local = transform(invert(submap.T_map_submap), mesh.vertices)
    # The last own voxel is centred half a voxel before 0, and its edge's quad reaches half a voxel to each side.
    assert local[:, 0].max() == pytest.approx(0, abs=1e-6)
    assert local[:, 0].min() < -1.9


def test_voxels_that_rays_only_passed_hold_no_surface() -> None:
    blocks = blocks_of(plane((0, 0, 1), 0.1), (-1, -1, -1), (1, 1, 1), 0.05)
    passed = dataclasses.replace(blocks, belonging=np.zeros_like(blocks.belonging))
    assert len(submap_mesh(submap_of(1, voxel=0.05), passed).faces) == 0


def test_unseen_voxels_lend_no_colour() -> None:
    voxel = 0.05
    blocks = blocks_of(plane((0, 0, 1), 0.1), (-1, -1, -1), (1, 1, 1), voxel)
    belonging, color = blocks.belonging.copy(), np.full_like(blocks.color, 200)
    x = (8 * blocks.coords[:, 0, None] + np.arange(8) + 0.5) * voxel
    unseen = np.broadcast_to((x > 0)[:, :, None, None], color.shape[:-1])
    belonging[unseen], color[unseen] = 0, 0
    mesh = submap_mesh(submap_of(1, voxel=voxel), dataclasses.replace(blocks, belonging=belonging, color=color))
    assert (mesh.colors == 200).all()


def test_black_things_stay_black() -> None:
    blocks = blocks_of(plane((0, 0, 1), 0.1), (-1, -1, -1), (1, 1, 1), 0.05)
    mesh = submap_mesh(submap_of(1, voxel=0.05), dataclasses.replace(blocks, color=np.zeros_like(blocks.color)))
    assert len(mesh.colors) > 0
    assert (mesh.colors == 0).all()


def test_no_surface_between_the_inside_and_free_space_beside_it() -> None:
    """Behind an edge that rays passed, the distance jumps from deep inside to the free space's truncation."""
    voxel = 0.05
    blocks = blocks_of(plane((0, 0, 1), 0.1), (-1, -1, -1), (1, 1, 1), voxel)
    x = (8 * blocks.coords[:, 0, None] + np.arange(8) + 0.5) * voxel
    distance, weight = blocks.distance.copy(), blocks.weight.copy()
    free = np.broadcast_to((x > 0)[:, :, None, None], distance.shape)
    distance[free], weight[free] = 32767, 3
    mesh = submap_mesh(submap_of(1, voxel=voxel), dataclasses.replace(blocks, distance=distance, weight=weight))
    # Less than a voxel behind the surface the step is no steeper than a surface's own; deeper, it is.
    assert mesh.vertices[:, 2].min() > 1.0 + 0.1 - 1.5 * voxel


def test_unobserved_corners_leave_a_hole() -> None:
    voxel = 0.05
    blocks = blocks_of(plane((0, 0, 1), 0.1), (-2, -2, -1), (2, 2, 1), voxel)
    weight = blocks.weight.copy()
    weight[len(weight) // 2, 3, 3, :] = 0
    submap = submap_of(1, voxel=voxel)
    whole, holed = submap_mesh(submap, blocks), submap_mesh(submap, dataclasses.replace(blocks, weight=weight))
    assert len(whole.faces) - len(holed.faces) == 2  # One edge crosses the plane at that voxel.
    assert len(boundary_edges(holed)) - len(boundary_edges(whole)) == 4


def test_colors_are_interpolated() -> None:
    voxel = 0.02
    submap = submap_of(1, voxel=voxel)
    mesh = submap_mesh(submap, blocks_of(sphere((0, 0, 0), 0.3), (-0.5,) * 3, (0.5,) * 3, voxel))
    local = transform(invert(submap.T_map_submap), mesh.vertices)
    np.testing.assert_allclose(mesh.colors, 128 + 100 * np.sin(5 * local), atol=3.0)


def test_surface_exactly_on_voxel_centres_has_no_degenerate_triangle() -> None:
    voxel = 0.02
    submap = submap_of(1, voxel=voxel)
    mesh = submap_mesh(submap, blocks_of(plane((0, 0, 1), 0.01), (-0.3,) * 3, (0.3,) * 3, voxel))
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-2 * voxel**2
    assert max(Counter(map(tuple, mesh.vertices.tolist())).values()) == 1


def test_no_blocks_no_mesh() -> None:
    empty = VoxelBlocks(
        coords=np.empty((0, 3), np.int32),
        distance=np.empty((0, 8, 8, 8), np.int16),
        weight=np.empty((0, 8, 8, 8), np.float32),
        color=np.empty((0, 8, 8, 8, 3), np.uint8),
        belonging=np.empty((0, 8, 8, 8, 2), np.uint8),
    )
    assert len(submap_mesh(submap_of(1), empty).faces) == 0
    assert len(merged([]).faces) == 0
