"""Surface voxels of random submaps against plain loops: how often each was seen, and giving them up."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from uppm.core.types import VoxelBlocks
from uppm.fusion.volume import Volume

SIZES = 0.05, 0.02


def random_volume(rng: np.random.Generator) -> tuple[Volume, list[int]]:
    """Two submaps of random voxels, the second turned and moved; their slots."""
    volume, slots = Volume(4096, 1e4, 0.2), []
    for size in SIZES:
        n, pose = 6, np.eye(4)
        if slots:
            pose[:3, :3], pose[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.013, -0.007, 0.021]
        slots.append(volume.add(size, 2 * size, pose, False))
        coords = np.unique(rng.integers(-1, 2, (n, 3)), axis=0).astype(np.int32)
        shape = (len(coords), 8, 8, 8)
        blocks = VoxelBlocks(
            coords=coords,
            distance=rng.integers(-32767, 32767, shape).astype(np.int16),
            weight=rng.integers(0, 2, shape).astype(np.float32),
            color=np.zeros((*shape, 3), dtype=np.uint8),
            belonging=rng.integers(0, 9, (*shape, 2)).astype(np.uint8),
        )
        volume.put(slots[-1], blocks)
    return volume, slots


def seen_there(volume: Volume, slot: int, size: float, point: npt.NDArray[np.float64]) -> int:
    """Times that the voxel at a point, frame submap, was seen as the submap's; 0 off its surface."""
    blocks = volume.gather(volume.indices(slot))
    voxel = np.floor(point / size).astype(int)
    for n, corner in enumerate(blocks.coords * 8):
        at = tuple(voxel - corner)
        if all(0 <= c < 8 for c in at):
            mine, foreign = (int(c) for c in blocks.belonging[n][at])
            near = abs(int(blocks.distance[n][at])) <= int(32767 * size / (2 * size))
            return mine if blocks.weight[n][at] > 0 and near and mine > 0 and mine >= foreign else 0
    return 0


def test_most_seen_is_the_greatest_count_of_the_surfaces_at_a_point() -> None:
    rng = np.random.default_rng(5)
    volume, slots = random_volume(rng)
    points = rng.uniform(-0.3, 0.3, (400, 3))
    turned = (points - [0.013, -0.007, 0.021]) @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    expected = [
        max(seen_there(volume, slots[0], SIZES[0], p), seen_there(volume, slots[1], SIZES[1], q))
        for p, q in zip(points, turned, strict=True)
    ]
    assert sum(count > 0 for count in expected) > 20
    np.testing.assert_array_equal(volume.most_seen(slots, points), expected)
    assert not volume.most_seen([], points).any()


def test_disowned_voxels_are_no_surface_and_their_neighbours_stay() -> None:
    volume, (slot, _) = random_volume(np.random.default_rng(6))
    voxels = volume.surface_voxels(slot)
    assert (volume.most_seen([slot], voxels[:, :3]) == voxels[:, 3]).all()
    volume.disown(slot, voxels[:20, :3], reach=0)
    np.testing.assert_array_equal(volume.surface_voxels(slot), voxels[20:])
    volume.disown(slot, voxels[20:21, :3])
    left = volume.surface_points(slot)
    around = np.abs(voxels[20:, :3] - voxels[20, :3]).max(axis=1) < 1.5 * SIZES[0]
    np.testing.assert_array_equal(left, voxels[20:, :3][~around])
