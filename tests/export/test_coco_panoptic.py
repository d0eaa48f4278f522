"""COCO's panoptic format: read by our own reader and by hotcoco, which follows panopticapi."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.map.scenes import CHAIR, CUP, WALL, submap_of
from uppm.core.errors import InputError
from uppm.core.types import Category, Intrinsics, SubmapKind
from uppm.core.views import RenderedView
from uppm.export.coco_panoptic import CocoPanoptic
from uppm.perception.segmentation.coco_panoptic import convert_coco_panoptic

CAMERA = Intrinsics(fx=20, fy=20, cx=15.5, cy=11.5, width=32, height=24)
CEILING = Category(id=100, name="ceiling-other", supercategory="ceiling", is_thing=False, voxel_size=0.05)
SUBMAPS = [
    submap_of(1, None, kind=SubmapKind.BACKGROUND),
    submap_of(2, WALL, kind=SubmapKind.BACKGROUND),
    submap_of(5, CHAIR),
    submap_of(300, CHAIR),
    submap_of(70_000, CUP),
    submap_of(9, WALL, kind=SubmapKind.BACKGROUND),
    submap_of(12, CEILING, kind=SubmapKind.BACKGROUND),
]
SEGMENTS = {0: 0, 1: 0, 2: 2, 9: 2, 5: 5, 300: 300, 70_000: 70_000, 12: 12}


def view_of(instance: np.ndarray) -> RenderedView:
    categories = {s.id: s.descriptor.category.id if s.descriptor else 0 for s in SUBMAPS} | {0: 0}
    return RenderedView(
        color=np.zeros((*instance.shape, 3), np.uint8),
        depth=(instance > 0).astype(np.float32),
        instance=instance,
        category=np.vectorize(categories.get)(instance).astype(np.int32),
        T_map_camera=np.eye(4),
        intrinsics=CAMERA,
    )


def instances(seed: int) -> np.ndarray:
    """(H, W): blocks of random ids, the later ones over the earlier."""
    rng, out = np.random.default_rng(seed), np.zeros((CAMERA.height, CAMERA.width), np.int32)
    for id_ in rng.permutation([0, *(s.id for s in SUBMAPS)]):
        y, x = rng.integers(0, CAMERA.height - 8), rng.integers(0, CAMERA.width - 8)
        out[y : y + rng.integers(3, 14), x : x + rng.integers(3, 20)] = id_
    return out


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("coco"), {3: instances(0), 40: instances(1), 41: instances(2)})


def write(folder: Path, views: dict[int, np.ndarray]) -> Path:
    coco = CocoPanoptic(folder, SUBMAPS)
    for index, instance in views.items():
        coco.add(index, view_of(instance))
    coco.finish()
    return folder / "panoptic.json"


def test_segments_are_the_submaps(written: Path) -> None:
    document: dict[str, Any] = json.loads(written.read_text())
    assert [(c["id"], c["isthing"]) for c in document["categories"]] == [
        (CUP.id, 1),
        (CHAIR.id, 1),
        (CEILING.id, 0),
        (WALL.id, 0),
    ]
    assert [image["id"] for image in document["images"]] == [3, 40, 41]
    for seed, annotation in enumerate(document["annotations"]):
        expected = np.vectorize(SEGMENTS.get)(instances(seed))
        found = cv2.imread(str(written.parent / "panoptic" / annotation["file_name"]))
        assert found is not None
        b, g, r = np.moveaxis(found.astype(int), 2, 0)
        np.testing.assert_array_equal(r + 256 * g + 65536 * b, expected)
        assert [s["id"] for s in annotation["segments_info"]] == sorted(set(expected.ravel().tolist()) - {0})
        for segment in annotation["segments_info"]:
            mask = expected == segment["id"]
            x, y, width, height = segment["bbox"]
            assert segment["area"] == mask.sum() == mask[y : y + height, x : x + width].sum()
            assert mask[y].any()
            assert mask[:, x].any()
            assert mask[y + height - 1].any()
            assert mask[:, x + width - 1].any()


def test_our_reader_gives_the_same_segments(written: Path, tmp_path: Path) -> None:
    done = convert_coco_panoptic(written, None, tmp_path / "segments")
    assert (done.frames, dict(done.dropped)) == (3, {})
    for seed, index in enumerate((3, 40, 41)):
        expected = np.vectorize(SEGMENTS.get)(instances(seed))
        ids = cv2.imread(str(tmp_path / "segments" / f"{index:05d}.png"), cv2.IMREAD_UNCHANGED)
        assert ids is not None
        with (tmp_path / "segments" / f"{index:05d}.csv").open() as file:
            rows = {int(row["id"]): (row["label"], row["thing"]) for row in csv.DictReader(file)}
        pairs = {(a, b) for a, b in zip(ids.ravel().tolist(), expected.ravel().tolist(), strict=True)}
        assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
        kinds: dict[int, tuple[str, str]] = {
            2: ("wall", "0"),
            12: ("ceiling", "0"),
            5: ("chair", "1"),
            300: ("chair", "1"),
            70_000: ("cup", "1"),
        }
        assert all(rows[int(a)] == kinds[int(b)] for a, b in pairs if b)


def test_panopticapi_reads_it_and_finds_it_equal_to_itself(written: Path, tmp_path: Path) -> None:
    panoptic = pytest.importorskip("hotcoco.panoptic", reason="needs `pip install hotcoco` (extra dev)")
    same = panoptic.pq_compute(str(written), str(written))
    assert (same["All"]["pq"], same["All"]["n"]) == (1.0, 4)
    moved = {index: np.roll(instances(seed), 2, axis=1) for seed, index in enumerate((3, 40, 41))}
    assert panoptic.pq_compute(str(written), str(write(tmp_path, moved)))["All"]["pq"] < 0.9


def test_an_id_beyond_24_bits_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected submap ids up to 16777215, found 16777216"):
        CocoPanoptic(tmp_path, [submap_of(1 << 24)])
