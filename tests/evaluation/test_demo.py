"""The demo sequence that the package ships: complete, small, true to its own ground truth, and attributed."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from collections import Counter
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import KDTree

from tests.conftest import shared_data
from uppm.evaluation.ground_truth import load_surface_truth

FRAMES = 40
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def demo() -> Path:
    return Path(str(resources.files("uppm.data").joinpath("demo")))


def image(path: Path) -> np.ndarray:
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None, path
    return found


def camera_points(demo: Path, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of a frame's pixels at depths up to 5 m, frame map, and their instances (N,)."""
    K, T_map_camera = np.loadtxt(demo / "intrinsics.txt"), np.loadtxt(demo / "pose" / f"{frame:05d}.txt")
    depth = image(demo / "depth" / f"{frame:05d}.png") / 1000.0
    v, u = np.nonzero((depth >= 0.1) & (depth <= 5))
    points = np.stack([u, v, np.ones_like(u)], axis=1) @ np.linalg.inv(K).T * depth[v, u, None]
    instance = image(demo / "instance" / f"{frame:05d}.png")[v, u]
    return points @ T_map_camera[:3, :3].T + T_map_camera[:3, 3], instance


def test_complete_and_small(demo: Path) -> None:
    for folder, suffix, shape, dtype in (
        ("color", "jpg", (240, 320, 3), np.uint8),
        ("depth", "png", (240, 320), np.uint16),
        ("instance", "png", (240, 320), np.uint16),
    ):
        files = sorted((demo / folder).iterdir())
        assert [file.name for file in files] == [f"{i:05d}.{suffix}" for i in range(FRAMES)]
        assert all(image(file).shape == shape and image(file).dtype == dtype for file in files)
    assert len(list((demo / "pose").iterdir())) == FRAMES
    assert sum(file.stat().st_size for file in demo.rglob("*") if file.is_file()) <= 5_000_000


def test_depth_poses_and_intrinsics_agree_with_the_surface(demo: Path) -> None:
    truth = load_surface_truth(demo)
    tree = KDTree(truth.points)
    for frame in range(0, FRAMES, 3):
        points, instance = camera_points(demo, frame)
        distance, nearest = tree.query(points[::7])
        # Points 15 mm apart: none further than the cell's diagonal and the source's 10 mm, but at depth edges.
        assert np.percentile(distance, 99) < 0.015
        assert np.mean(truth.instance[nearest] == instance[::7]) > 0.99


def test_every_surface_point_was_seen(demo: Path) -> None:
    truth = load_surface_truth(demo)
    seen = np.concatenate([camera_points(demo, frame)[0] for frame in range(FRAMES)])
    distance, _ = KDTree(seen).query(truth.points[::31])
    assert np.percentile(distance, 99) < 0.03


def test_labels_count_the_pixels_and_name_the_authors(demo: Path) -> None:
    pixels = Counter[int]()
    for frame in range(FRAMES):
        ids, counts = np.unique(image(demo / "instance" / f"{frame:05d}.png"), return_counts=True)
        pixels.update(dict(zip(ids.tolist(), counts.tolist(), strict=True)))
    with (demo / "labels.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {int(row["instance"]): int(row["pixels"]) for row in rows} == {i: n for i, n in pixels.items() if i}
    sources = [row["source"] for row in rows if row["source"]]
    assert len(sources) > 40
    attribution = (demo / "README.md").read_text(encoding="utf-8")
    for source in sources:
        catalogue, author = re.fullmatch(r"(\S+)#\d+ (.+)", source).groups()  # pyright: ignore[reportOptionalMemberAccess]
        assert author
        assert catalogue in attribution


@pytest.mark.heavy
def test_made_again_it_has_the_same_bytes(demo: Path, tmp_path: Path) -> None:
    source = shared_data("data/flat/run1")
    subprocess.run([sys.executable, ROOT / "tools" / "make_demo.py", source, tmp_path / "demo"], check=True)
    made = {file.relative_to(tmp_path / "demo"): file.read_bytes() for file in (tmp_path / "demo").rglob("*.*")}
    assert made == {file.relative_to(demo): file.read_bytes() for file in demo.rglob("*.*")}
