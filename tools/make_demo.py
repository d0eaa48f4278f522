"""Make the demo sequence that the package ships from the rendered flat: `python tools/make_demo.py FLAT_RUN1 [OUT]`.

Pixel (u, v) of the demo is pixel (2u, 2v) of the source, so depth and instances are exact samples, never mixed
across edges, and the camera matrix is the source's with its first two rows halved. Colour is low-passed by a
filter centred on the same pixel. The same input gives the same bytes.
"""

from __future__ import annotations

import csv
import shutil
import sys
from collections import Counter
from pathlib import Path

import cv2
import numpy as np

FRAMES = (
    *(16, 17, 18, 19, 22, 24, 25, 27, 30, 33, 36, 39, 41, 42, 43, 44, 46, 49, 53, 56),
    *(59, 62, 63, 64, 66, 69, 70, 74, 77, 79, 80, 83, 86, 88, 90, 91, 92, 93, 94, 95),
)
"""Source frames of living room and kitchen, chosen for many distinct things that the detector finds in at least two
of them; at least 39 % of what a frame shows, the frame before shows too."""
JPEG_QUALITY = 95
SURFACE_SPACING_MM = 15
DEPTH_RANGE_M = (0.1, 5.0)
OUT = Path(__file__).resolve().parents[1] / "src" / "uppm" / "data" / "demo"
README = Path(__file__).with_name("demo_readme.md")


def main(source: Path, out: Path) -> None:
    """Write the whole sequence anew."""
    shutil.rmtree(out, ignore_errors=True)
    for folder in ("color", "depth", "instance", "pose"):
        (out / folder).mkdir(parents=True)
    pixels = Counter[int]()
    for index, frame in enumerate(FRAMES):
        pixels.update(write_frame(source, out, frame, index))
    K = np.loadtxt(source / "intrinsics.txt")
    np.savetxt(out / "intrinsics.txt", np.diag((0.5, 0.5, 1.0)) @ K, fmt="%.6f")
    write_labels(source, out, pixels)
    write_surface(source, out, K)
    shutil.copyfile(README, out / "README.md")


def write_frame(source: Path, out: Path, frame: int, index: int) -> dict[int, int]:
    """Subsample one frame; returns instance -> pixels in the written image."""
    color = cv2.GaussianBlur(read(source / "color" / f"{frame:05d}.jpg", cv2.IMREAD_COLOR), (3, 3), 0)[::2, ::2]
    cv2.imwrite(str(out / "color" / f"{index:05d}.jpg"), color, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    for folder in ("depth", "instance"):
        image = read(source / folder / f"{frame:05d}.png", cv2.IMREAD_UNCHANGED)[::2, ::2]
        cv2.imwrite(str(out / folder / f"{index:05d}.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    shutil.copyfile(source / "pose" / f"{frame:05d}.txt", out / "pose" / f"{index:05d}.txt")
    ids, counts = np.unique(image, return_counts=True)
    return dict(zip(ids.tolist(), counts.tolist(), strict=True))


def write_labels(source: Path, out: Path, pixels: Counter[int]) -> None:
    """The rows, authors included, of the instances that the demo's frames show."""
    with (source / "labels.csv").open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        rows = [row | {"pixels": pixels[int(row["instance"])]} for row in reader if pixels[int(row["instance"])]]
        fields = reader.fieldnames or ()
    with (out / "labels.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, fields, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def write_surface(source: Path, out: Path, K: np.ndarray) -> None:
    """The source's ground-truth points that the chosen frames see, one a cell and instance."""
    with np.load(source / "surface.npz") as surface:
        xyz_mm, instance = surface["xyz_mm"], surface["instance"]
    cell = (xyz_mm.astype(np.int64) + 2**15) // SURFACE_SPACING_MM
    _, first = np.unique(cell @ (1 << 48, 1 << 32, 1 << 16) + instance, return_index=True)
    xyz_mm, instance = xyz_mm[first], instance[first]
    seen = np.zeros(len(xyz_mm), dtype=bool)
    for frame in FRAMES:
        seen |= visible(source, frame, K, xyz_mm / 1000.0, instance)
    np.savez_compressed(out / "surface.npz", xyz_mm=xyz_mm[seen], instance=instance[seen])


def visible(source: Path, frame: int, K: np.ndarray, points: np.ndarray, instance: np.ndarray) -> np.ndarray:
    """(N,) bool: points whose depth is within range and that project to a pixel of their instance at their depth."""
    depth = read(source / "depth" / f"{frame:05d}.png", cv2.IMREAD_UNCHANGED) / 1000.0
    ids = read(source / "instance" / f"{frame:05d}.png", cv2.IMREAD_UNCHANGED)
    T_camera_map = np.linalg.inv(np.loadtxt(source / "pose" / f"{frame:05d}.txt"))
    camera = points @ T_camera_map[:3, :3].T + T_camera_map[:3, 3]
    z = camera[:, 2]
    near = np.flatnonzero((z >= DEPTH_RANGE_M[0]) & (z <= DEPTH_RANGE_M[1]))
    u, v = np.rint((camera[near] @ K.T)[:, :2] / z[near, None]).astype(int).T
    inside = (u >= 0) & (u < depth.shape[1]) & (v >= 0) & (v < depth.shape[0])
    near, u, v = near[inside], u[inside], v[inside]
    agrees = (np.abs(depth[v, u] - z[near]) < 0.01 + 0.01 * z[near]) & (ids[v, u] == instance[near])
    result = np.zeros(len(points), dtype=bool)
    result[near[agrees]] = True
    return result


def read(path: Path, flags: int) -> np.ndarray:
    image = cv2.imread(str(path), flags)
    if image is None:
        raise SystemExit(f"{path}: not a readable image; give the folder flat/run1 of the development data")
    return image


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else OUT)
