"""Best views: of two boxes, one of which hides the other from half of the cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest

from tests.scenes import CAMERA, Box, look_at, render
from uppm.core.errors import BadFrameError
from uppm.core.types import Frame, Mesh
from uppm.viewer.crops import MIN_GAP, best_crops

NEAR, FAR = Box([0.4, -0.5, 0], [0.5, 0.5, 1.0]), Box([-0.2, -0.2, 0], [0.2, 0.2, 0.4])
EYES = [[3 * np.cos(a), 3 * np.sin(a), 0.3] for a in np.linspace(0, np.pi, 40)]
"""From behind the near box to the other side."""


class Turn:
    """The cameras of `EYES`; frame 39, the best of all, cannot be read."""

    name = "turn"
    indices: Sequence[int] = range(len(EYES))

    def __init__(self) -> None:
        self.opened: list[int] = []

    def __len__(self) -> int:
        return len(EYES)

    def frame(self, position: int, /) -> Frame:
        self.opened.append(position)
        if position == 39:
            raise BadFrameError("39", expected="a picture", found="none", advice="leave it out")
        return render([NEAR, FAR], pose(position), position)[0]


def pose(position: int) -> npt.NDArray[np.float64]:
    return look_at(EYES[position], [0, 0, 0.2])


def surface(box: Box) -> Mesh:
    """The sides of a box as points with normals."""
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9)))
    points, normals = [], []
    for axis in range(3):
        for end in (0.0, 1.0):
            at = np.insert(np.stack([u, v], axis=1), axis, end, axis=1)
            points.append(box.low + at * (box.high - box.low))
            normals.append(np.tile((2 * end - 1) * np.eye(3)[axis], (len(u), 1)))
    vertices = np.concatenate(points).astype(np.float32)
    return Mesh(
        vertices=vertices,
        normals=np.concatenate(normals).astype(np.float32),
        colors=np.zeros((len(vertices), 3), dtype=np.uint8),
        faces=np.zeros((0, 3), dtype=np.int32),
    )


def test_best_views_show_the_object_and_not_what_hides_it() -> None:
    source = Turn()
    found = best_crops({7: surface(FAR)}, [(n, pose(n)) for n in range(40)], source)[7]
    assert len(found) == 3
    frames = [crop.frame for crop in found]
    assert min(frames) > 10
    assert 39 not in frames
    assert np.diff(sorted(frames)).min() >= MIN_GAP
    assert len(source.opened) <= 10
    for crop in found:
        assert crop.share > 0.2
        middle = crop.image[crop.image.shape[0] // 2, crop.image.shape[1] // 2]
        np.testing.assert_array_equal(middle, (120, 80, 0))
        assert crop.jpeg()[:2] == b"\xff\xd8"
        assert max(crop.image.shape[:2]) < CAMERA.width


@pytest.mark.parametrize("path", [[], [(77, np.eye(4))], [(n, look_at([9, 9, 1], [20, 20, 1])) for n in range(40)]])
def test_no_view_is_none(path: list[tuple[int, npt.NDArray[np.float64]]]) -> None:
    assert best_crops({7: surface(FAR)}, path, Turn()) == {}
