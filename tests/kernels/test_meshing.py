"""The meshing kernels against their NumPy reference, and the table of sheets against what a closed surface asks."""

from __future__ import annotations

import numpy as np
import pytest

from tests.map.scenes import submap_of
from uppm._kernels import meshing, reference
from uppm._kernels.sheets import EDGES as STORED_EDGES
from uppm._kernels.sheets import SHEET, SHEETS
from uppm.core.types import VoxelBlocks
from uppm.map.mesh import block_keys, pieces

EDGES = STORED_EDGES.astype(int)
CONSTANTS = {name: float(getattr(meshing, name)) for name in ("STEEP", "DEEP", "ALIKE", "PULL", "FILL", "SLACK")}


def test_each_sheet_meets_each_face_of_its_cell_in_whole_pairs() -> None:
    """So that the sheets of neighbouring cells join, and a mesh has no loose end."""
    for case in range(256):
        crossed = [e for e in range(12) if (case >> EDGES[e, 0] & 1) != (case >> EDGES[e, 1] & 1)]
        assert [e for e in range(12) if SHEET[case, e] >= 0] == crossed
        assert sorted(set(SHEET[case, crossed].tolist())) == list(range(SHEETS[case]))
        for axis in range(3):
            for side in (0, 1):
                face = [e for e in crossed if (EDGES[e] >> axis & 1 == side).all()]
                for sheet in range(SHEETS[case]):
                    assert sum(SHEET[case, e] == sheet for e in face) in (0, 2, 4)


def test_opposite_corners_are_two_sheets() -> None:
    assert SHEETS[0b10000001] == SHEETS[0b01111110] == 2
    assert SHEETS[0b00000001] == SHEETS[0b00001111] == 1


def field_of(seed: int) -> np.ndarray:
    """(16, 16, 16): distances in voxels from a ball, a box and a wall with noise and holes; NaN where not observed."""
    rng = np.random.default_rng(seed)
    p = np.stack(np.meshgrid(*[np.arange(16.0)] * 3, indexing="ij"), axis=-1)
    ball = np.linalg.norm(p - rng.uniform(4, 8, 3), axis=-1) - 3
    box = np.abs(p - rng.uniform(9, 12, 3)).max(axis=-1) - 2.5
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0][0]
    wall = np.abs((p - 7) @ turned) - 0.4
    field = np.minimum(np.minimum(ball, box), np.where(p[..., 0] < 5, wall, 9.0)) + rng.normal(0, 0.05, p.shape[:3])
    field[rng.random(field.shape) < 0.02] = np.nan
    return np.clip(field, -2, 2)


@pytest.mark.parametrize("seed", [0, 1])
def test_vertices_agree_with_the_reference(seed: int) -> None:
    field = field_of(seed)
    stored = np.rint(np.nan_to_num(field) / 2 * 32767)
    tiles = stored.reshape(2, 8, 2, 8, 2, 8).transpose(0, 2, 4, 1, 3, 5).reshape(8, 8, 8, 8)
    seen = (~np.isnan(field)).reshape(2, 8, 2, 8, 2, 8).transpose(0, 2, 4, 1, 3, 5).reshape(8, 8, 8, 8)
    blocks = VoxelBlocks(
        coords=np.array(list(np.ndindex(2, 2, 2)), dtype=np.int32),
        distance=tiles.astype(np.int16),
        weight=seen.astype(np.float32),
        color=np.zeros((8, 8, 8, 8, 3), dtype=np.uint8),
        belonging=np.ones((8, 8, 8, 8, 2), dtype=np.uint8),
    )
    keys = block_keys(blocks.coords)
    got = pieces(submap_of(1), blocks, keys, keys, {})
    expected = reference.dual_vertices(np.where(np.isnan(field), np.nan, (stored + 0.5) * 2 / 32767), CONSTANTS)
    compared = 0
    for coord, key in zip(blocks.coords, keys.tolist(), strict=True):
        piece = got[key]
        for cell in np.ndindex(8, 8, 8):
            place = tuple((8 * coord + cell).tolist())
            case, sheets = piece.cases[(slice(None), *cell)]
            if max(place) == 15:
                continue
            assert (sheets > 0) == (place in expected)
            if sheets and SHEETS[case] == 1:
                vertex, normal = piece.vertices[piece.first[cell]], piece.normals[piece.first[cell]]
                np.testing.assert_allclose(vertex - place, expected[place][0], atol=2e-3)
                np.testing.assert_allclose(normal, expected[place][1], atol=2e-3)
                compared += 1
    assert compared > 300
