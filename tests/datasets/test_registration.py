"""Depth registered to the colour camera keeps planes, hides what is hidden, and loses no measurement."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.datasets.formats import DEPTH_CAMERA, T_COLOR_DEPTH
from tests.datasets.scene import CAMERA
from uppm.core.errors import InputError
from uppm.core.geometry import invert, rays
from uppm.core.types import Intrinsics
from uppm.datasets import register_depth

SIZE = (CAMERA.width, CAMERA.height)


def plane_depth(camera: Intrinsics, normal: np.ndarray, offset: float | np.floating) -> np.ndarray:
    """Depth of the plane n . p = offset."""
    return (offset / (rays(camera) @ normal)).astype(np.float32)


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(0.8, 3.0), st.floats(-0.2, 0.2))
def test_a_plane_stays_that_plane(a: float, b: float, offset: float, yaw: float) -> None:
    normal = np.array([a, b, 1.0])
    T = T_COLOR_DEPTH.copy()
    T[:3, :3] = [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
    n_color = T[:3, :3] @ normal
    depth = plane_depth(DEPTH_CAMERA, normal, offset)
    out = register_depth(depth, DEPTH_CAMERA.matrix, CAMERA.matrix, T, SIZE)
    expected = plane_depth(CAMERA, n_color, offset + float(n_color @ T[:3, 3]))
    error = np.abs(out - expected) / expected
    assert out.shape == (CAMERA.height, CAMERA.width)
    assert np.median(error[out > 0]) < 1e-5
    assert (error[out > 0] < 1e-4).mean() > 0.9  # single points at the border are at most a pixel's slope off
    inner = out[20:-20, 40:-40]
    assert (inner > 0).mean() > 0.9


def test_the_same_camera_gives_the_same_depth() -> None:
    depth = np.random.default_rng(0).uniform(1, 4, (CAMERA.height, CAMERA.width)).astype(np.float32)
    depth[depth > 3.5] = 0
    out = register_depth(depth, CAMERA.matrix, CAMERA.matrix, np.eye(4), SIZE)
    assert np.allclose(out, depth, rtol=1e-6)


def test_the_nearer_surface_hides_the_farther() -> None:
    depth = np.full((DEPTH_CAMERA.height, DEPTH_CAMERA.width), 3.0, np.float32)
    depth[:, 40:60] = 1.0
    T = np.eye(4)
    T[0, 3] = 0.2
    out = register_depth(depth, DEPTH_CAMERA.matrix, CAMERA.matrix, T, SIZE)
    assert set(np.unique(out.round(4))) == {0.0, 1.0, 3.0}
    u = np.array([40, 59])
    edges = CAMERA.fx * ((u - DEPTH_CAMERA.cx) / DEPTH_CAMERA.fx + 0.2) + CAMERA.cx
    row = out[CAMERA.height // 2]
    assert (row[int(np.ceil(edges[0])) : int(np.floor(edges[1])) + 1] == 1.0).all()


def test_single_measurements_are_kept() -> None:
    depth = np.zeros((DEPTH_CAMERA.height, DEPTH_CAMERA.width), np.float32)
    depth[10::8, 10::8] = 2.0
    out = register_depth(depth, DEPTH_CAMERA.matrix, CAMERA.matrix, T_COLOR_DEPTH, SIZE)
    v, u = np.nonzero(depth)
    points = rays(DEPTH_CAMERA)[v, u] * 2.0 + T_COLOR_DEPTH[:3, 3]
    columns = CAMERA.fx * points[:, 0] / points[:, 2] + CAMERA.cx
    rows = CAMERA.fy * points[:, 1] / points[:, 2] + CAMERA.cy
    inside = (columns >= 0) & (columns <= CAMERA.width - 1) & (rows >= 0) & (rows <= CAMERA.height - 1)
    assert (out > 0).sum() == inside.sum()
    assert np.allclose(out[out > 0], 2.0 + T_COLOR_DEPTH[2, 3])


def test_points_behind_the_colour_camera_are_left_out() -> None:
    depth = np.full((DEPTH_CAMERA.height, DEPTH_CAMERA.width), 1.0, np.float32)
    away = invert(np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2.0], [0, 0, 0, 1]]))
    assert not register_depth(depth, DEPTH_CAMERA.matrix, CAMERA.matrix, away, SIZE).any()


def test_extrinsics_that_are_not_finite() -> None:
    depth = np.ones((4, 4), np.float32)
    with pytest.raises(InputError, match="NaN"):
        register_depth(depth, CAMERA.matrix, CAMERA.matrix, np.full((4, 4), np.nan), SIZE)
