"""Pictures: geometry by hand, and what a person would look for."""

from __future__ import annotations

import numpy as np
import pytest

from tests.map.scenes import CUP, WALL, blocks_of, box, plane, sphere, submap_of
from tests.map.test_mesh import boundary_edges
from uppm.core.types import Mesh, Submap, SubmapKind, VoxelBlocks
from uppm.map.mesh import submap_mesh
from uppm.map.palette import distinct
from uppm.map.panoptic_map import PanopticMap
from uppm.map.pictures import birds_eye, section, top_down
from uppm.map.render import BACKGROUND, choose_view, look_along, render, top_view, with_labels


def quad(low: tuple[float, float], high: tuple[float, float], z: float, color: tuple[int, int, int]) -> Mesh:
    """A horizontal rectangle that faces up."""
    (x0, y0), (x1, y1) = low, high
    return Mesh(
        vertices=np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]], np.float32),
        normals=np.tile(np.array([0, 0, 1], np.float32), (4, 1)),
        colors=np.tile(np.array(color, np.uint8), (4, 1)),
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
    )


@pytest.mark.parametrize("view", [look_along((0, 0, -1), (0, 1, 0)), look_along((0, 0, -1), (0, 1, 0), 0.7)])
def test_picture_is_filled_and_upright(view) -> None:
    picture = render(quad((1, 2), (5, 4), 0.5, (200, 40, 40)), view, width=200, height=100)
    red = picture.image[..., 0].astype(int) - picture.image[..., 1] > 60
    rows, columns = np.flatnonzero(red.any(axis=1)), np.flatnonzero(red.any(axis=0))
    assert 0 < columns[0] < 12
    assert 188 < columns[-1] < 199
    np.testing.assert_allclose(picture.locate(np.array([[3, 3, 0.5]]))[0], (99.5, 49.5), atol=0.01)
    corner = picture.locate(np.array([[1, 4, 0.5]]))[0]  # Low x is left, high y is up.
    np.testing.assert_allclose(corner, (columns[0] - 0.5, rows[0] - 0.5), atol=1.1)
    assert (picture.image[0, 0] == BACKGROUND).all()


def test_ceiling_is_not_seen_from_above() -> None:
    floor = quad((0, 0), (4, 3), 0, (40, 200, 40))
    ceiling = quad((0, 0), (4, 3), 2.5, (200, 40, 40))
    room = Mesh(
        vertices=np.concatenate([floor.vertices, ceiling.vertices]),
        normals=np.concatenate([floor.normals, -ceiling.normals]),
        colors=np.concatenate([floor.colors, ceiling.colors]),
        faces=np.concatenate([floor.faces, ceiling.faces[:, ::-1] + 4]),
    )
    bounds = np.stack([room.vertices.min(0), room.vertices.max(0)])
    for view in (top_view(bounds), choose_view(bounds)):
        middle = render(room, view, width=160, height=120).image[60, 80].astype(int)
        assert middle[1] > middle[0] + 60


@pytest.mark.parametrize("up", [(0, 0, 1), (0, -1, 0), (1, 0, 0)])
def test_views_follow_the_up_axis(up: tuple[float, float, float]) -> None:
    bounds = np.array([[0, 0, 0], [5.0, 3.0, 2.0]])
    for view in (top_view(bounds, up), choose_view(bounds, up)):
        R = view.R_view_map
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1)
        assert R[2] @ np.asarray(up) < -0.5
    assert choose_view(bounds, up).R_view_map[1] @ np.asarray(up) < -0.3


def test_section_of_a_box_is_its_outline() -> None:
    mesh = submap_mesh(submap_of(1), blocks_of(box((0, 0, 0), (0.4, 0.3, 0.5)), (-0.2,) * 3, (0.7,) * 3, 0.02))
    assert len(boundary_edges(mesh)) == 0
    segments = section(mesh, np.array([0.0, 0.0, 1.0]), 1.2501)
    np.testing.assert_allclose(segments[..., 2], 1.2501, atol=1e-5)
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum()
    assert length == pytest.approx(2 * (0.4 + 0.3), rel=0.05)


def test_labels_do_not_cover_each_other() -> None:
    picture = render(quad((0, 0), (4, 3), 0, (240, 240, 240)), look_along((0, 0, -1), (0, 1, 0)), width=800, height=600)
    before = picture.image.copy()
    names = [(f"thing {i}", np.array([2.0, 1.5, 0.0]), distinct(i)) for i in range(6)]
    image = with_labels(picture, names)
    np.testing.assert_array_equal(picture.image, before)
    for _, _, color in names:
        fill = [round(0.35 * c + 0.65 * 255) for c in color]
        assert (image == fill).all(axis=-1).sum() > 300, "a label is hidden"


class Scene:
    def __init__(self, parts: dict[int, VoxelBlocks]) -> None:
        self.parts = parts

    def blocks(self, submap_id: int) -> VoxelBlocks:
        return self.parts[submap_id]


def test_pictures_of_a_map() -> None:
    submaps: list[Submap] = [
        submap_of(1, CUP, bounds=((0.3, -0.45, 0.8), (0.7, -0.05, 1.2))),
        submap_of(2, WALL, kind=SubmapKind.BACKGROUND, voxel=0.05),
    ]
    ball = blocks_of(sphere((0, 0, 0), 0.2), (-0.3,) * 3, (0.3,) * 3, 0.02)
    floor = blocks_of(plane((0, 0, 1), -0.3), (-1.2, -0.8, -0.5), (1.2, 0.8, 0.1), 0.05)
    panoptic = PanopticMap(submaps=submaps, voxels=Scene({1: ball, 2: floor}))
    image = top_down(panoptic, coloring="instance", labels=False, width=300)
    assert image.shape[1] == 300
    assert image.shape[0] == pytest.approx(300 * 1.6 / 2.4, rel=0.03)
    assert not (top_down(panoptic, coloring="instance", width=300) == image).all()
    view = birds_eye(panoptic, width=200, height=150)
    assert view.shape == (150, 200, 3)
    assert 0.2 < (view != BACKGROUND).any(axis=-1).mean() < 0.95


def test_a_map_without_surfaces_still_has_a_picture() -> None:
    panoptic = PanopticMap(submaps=[], voxels=Scene({}))
    assert (birds_eye(panoptic, width=60, height=40) == BACKGROUND).all()
    assert (top_down(panoptic, width=60) == BACKGROUND).all()
