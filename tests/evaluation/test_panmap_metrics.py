"""The errors after Panoptic Multi-TSDFs, on layers whose distances are known."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.interpolate import RegularGridInterpolator

from uppm.core.types import VOXELS_PER_SIDE, VoxelBlocks
from uppm.evaluation.geometry import PointIndex
from uppm.evaluation.panmap_metrics import TsdfLayer, interpolated_distance, panmap_metrics

SIZE, TRUNCATION = 0.05, 0.1
SPAN = 3 * VOXELS_PER_SIDE


def layer(field: npt.NDArray[np.float64], T: npt.NDArray[np.float64] | None = None) -> TsdfLayer:
    """A cube of 3x3x3 blocks whose lowest one has coordinates -1; `field` (24, 24, 24) metres, NaN: not observed."""
    n = VOXELS_PER_SIDE
    coords = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.int32)
    cut = np.stack([field[tuple(slice((c + 1) * n, (c + 2) * n) for c in block)] for block in coords])
    belonging = np.zeros((*cut.shape, 2), dtype=np.uint8)
    belonging[..., 0] = 1
    blocks = VoxelBlocks(
        coords=coords,
        distance=np.rint(np.nan_to_num(np.clip(cut / TRUNCATION, -1, 1)) * 32767).astype(np.int16),
        weight=np.isfinite(cut).astype(np.float32),
        color=np.zeros((*cut.shape, 3), dtype=np.uint8),
        belonging=belonging,
    )
    return TsdfLayer(blocks=blocks, voxel_size=SIZE, truncation=TRUNCATION, T_map_submap=np.eye(4) if T is None else T)


def centres() -> npt.NDArray[np.float64]:
    """Voxel centres along an axis of the layer, metres."""
    return (np.arange(SPAN, dtype=np.float64) - VOXELS_PER_SIDE + 0.5) * SIZE


def plane(height: float = 0.0) -> npt.NDArray[np.float64]:
    """Distance over a horizontal plane."""
    return np.broadcast_to(centres() - height, (SPAN,) * 3).copy()


def test_plane_by_hand() -> None:
    truth = np.array([[0.1, 0.1, 0.03], [0.2, 0.3, -0.02], [0.1, 0.2, 0.25], [9, 9, 9.0]])
    # 3 and 2 cm; over the band the stored distance is the truncation, 10 cm; the last point is unknown.
    found = panmap_metrics([layer(plane())], np.array([[0.1, 0.1, 0.0]]), PointIndex(truth))
    assert found.panmap_gt_error_cm == pytest.approx((3 + 2 + 10) / 3, abs=1e-3)
    assert found.panmap_gt_rmse_cm == pytest.approx(np.sqrt((9 + 4 + 100) / 3), abs=1e-3)
    assert found.panmap_gt_unknown_ratio == 0.25
    assert found.panmap_gt_inlier_ratio == 0.75
    assert found.panmap_map_error_cm == pytest.approx(3)


def test_of_two_submaps_the_lower_signed_distance() -> None:
    found = panmap_metrics(
        [layer(plane(0.0)), layer(plane(0.05))], np.empty((0, 3)), PointIndex(np.array([[0.1, 0.1, 0.06]]))
    )
    assert found.panmap_gt_error_cm == pytest.approx(1, abs=1e-3)
    assert found.panmap_map_error_cm is None


def test_agrees_with_another_interpolation() -> None:
    random = np.random.default_rng(3)
    field = random.uniform(-TRUNCATION, TRUNCATION, (SPAN,) * 3)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.3, -2, 1]
    local = random.uniform(-0.37, 0.77, (500, 3))
    expected = RegularGridInterpolator((centres(),) * 3, field)(local)
    found = interpolated_distance(layer(field, T), local @ T[:3, :3].T + T[:3, 3])
    assert found == pytest.approx(expected, abs=1e-5)


def test_beside_what_was_not_observed_nothing_is_known() -> None:
    field = plane()
    field[9, 9, 9] = np.nan
    centre = centres()[9]
    found = interpolated_distance(layer(field), np.array([[centre, centre, centre], [centre + 0.1, centre, centre]]))
    assert np.isnan(found[0])
    assert found[1] == pytest.approx(centre, abs=1e-5)


def test_foreign_voxels_are_not_asked() -> None:
    whole = layer(plane())
    whole.blocks.belonging[..., 1] = 2
    assert np.isnan(interpolated_distance(whole, np.array([[0.1, 0.1, 0.0]]))).all()
