"""Small scenes with known answers, and a sequence folder with ground truth of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from uppm.core.types import Mesh

LABELS = """instance,name,thing,categories,pixels,source
1,floor,0,floor-other|floor-wood,90000,
2,mug,1,cup,5000,
3,sofa,1,couch|chair,9000,
4,coin,1,metal,10,
"""


def square(x: float, y: float, z: float, side: float = 1.0) -> Mesh:
    """A horizontal square of two triangles with its lowest corner at (x, y, z)."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float32) * side
    return mesh_of(corners + np.array([x, y, z], dtype=np.float32), [[0, 1, 2], [0, 2, 3]])


def mesh_of(vertices: npt.ArrayLike, faces: npt.ArrayLike = ()) -> Mesh:
    """A mesh without normals and colours."""
    points = np.asarray(vertices, dtype=np.float32)
    return Mesh(
        vertices=points,
        normals=np.zeros_like(points),
        colors=np.zeros(points.shape, dtype=np.uint8),
        faces=np.asarray(faces, dtype=np.int32).reshape(-1, 3),
    )


def grid(x: float, y: float, z: float, side: float = 1.0, step: float = 0.01) -> npt.NDArray[np.float64]:
    """Points (N, 3) of a horizontal square, one in the middle of each cell."""
    along = np.arange(step / 2, side, step)
    u, v = np.meshgrid(along, along, indexing="ij")
    return np.stack([x + u.ravel(), y + v.ravel(), np.full(u.size, z)], axis=1)


def write_truth(folder: Path, instances: dict[int, npt.NDArray[np.float64]], labels: str = LABELS) -> Path:
    """A `frames` folder with the ground truth alone."""
    folder.mkdir(parents=True, exist_ok=True)
    xyz = np.concatenate(list(instances.values()))
    ids = np.repeat(list(instances), [len(p) for p in instances.values()])
    np.savez_compressed(
        folder / "surface.npz", xyz_mm=np.rint(1000 * xyz).astype(np.int16), instance=ids.astype(np.uint16)
    )
    (folder / "labels.csv").write_text(labels, encoding="utf-8")
    return folder
