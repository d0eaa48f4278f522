"""The rendered room of the reader tests, with instances, labels and a surface: the smallest sequence with all parts."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tests.datasets.scene import BALLS, CAMERA, HALF, image, pose, render, write_frames
from uppm.core.geometry import backproject, transform

COUNT = 12
NAMES = ("floor-wood", "ceiling-tile", "wall-concrete", "sports ball", "orange")
"""Instance k is `NAMES[k - 1]`; the balls are things."""


def instances(points: npt.NDArray) -> npt.NDArray[np.uint16]:
    """Ids (...) of points (..., 3) on the room's surfaces."""
    ids = np.full(points.shape[:-1], 3, dtype=np.uint16)
    ids[np.abs(points[..., 2] + HALF[2]) < 5e-3] = 1
    ids[np.abs(points[..., 2] - HALF[2]) < 5e-3] = 2
    for number, (centre, radius) in enumerate(BALLS, 4):
        ids[np.linalg.norm(points - centre, axis=-1) < radius + 5e-3] = number
    return ids


def write_room(root: Path, count: int = COUNT) -> Path:
    """The `frames` layout with ground truth."""
    write_frames(root, count=count)
    clouds, pixels = [], np.zeros(len(NAMES) + 1, dtype=int)
    for i in range(count):
        points = transform(pose(i), backproject(render(pose(i))[1], CAMERA).reshape(-1, 3))
        ids = instances(points)
        image(root / f"instance/{i:05d}.png", ids.reshape(CAMERA.height, CAMERA.width))
        clouds.append(points)
        pixels += np.bincount(ids, minlength=len(NAMES) + 1)
    rows = [f"{k},{name},{int(k > 3)},{name},{pixels[k]}" for k, name in enumerate(NAMES, 1)]
    (root / "labels.csv").write_text("\n".join(["instance,name,thing,categories,pixels", *rows]) + "\n")
    cloud = np.concatenate(clouds)[::20]
    np.savez(root / "surface.npz", xyz_mm=np.rint(1000 * cloud).astype(np.int16), instance=instances(cloud))
    return root


def write_precomputed(folder: Path, room: Path) -> Path:
    """The room's instances as some other segmenter's output."""
    folder.mkdir()
    for file in (room / "instance").iterdir():
        shutil.copyfile(file, folder / file.name)
    rows = [f"{k},{name},{int(k > 3)}" for k, name in enumerate(NAMES, 1)]
    (folder / "labels.csv").write_text("\n".join(["id,label,thing", *rows]) + "\n")
    return folder
