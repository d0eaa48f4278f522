"""COCO panoptic JSON and PNG, as other segmenters write them, into a folder that is mapped."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from uppm.core.config import PerceptionConfig
from uppm.core.errors import InputError
from uppm.perception import fakes
from uppm.perception.registry import create_segmenter
from uppm.perception.segmentation.coco_panoptic import convert_coco_panoptic

MUG, WALL, GHOST, CROWD = 7, 300, 70_000, 9


def document() -> dict[str, Any]:
    return {
        "images": [{"id": 11, "file_name": "run1/frame-000000.color.jpg", "height": 48, "width": 64}],
        "categories": [
            {"id": 47, "name": "cup", "isthing": 1, "supercategory": "kitchen"},
            {"id": 199, "name": "wall-other-merged", "isthing": 0, "supercategory": "wall"},
        ],
        "annotations": [
            {
                "image_id": 11,
                "file_name": "frame-000000.png",
                "segments_info": [
                    {"id": MUG, "category_id": 47, "area": 5, "iscrowd": 0, "score": 0.75},
                    {"id": WALL + 65536, "category_id": 199, "iscrowd": 0},
                    {"id": GHOST, "category_id": 47, "iscrowd": 0},
                    {"id": CROWD, "category_id": 47, "iscrowd": 1},
                ],
            }
        ],
    }


def write(folder: Path, content: Any) -> Path:
    """The JSON with its PNG: 20 columns of mug, 24 of wall, 4 of a crowd, the rest nothing."""
    ids = np.zeros((48, 64), dtype=np.int64)
    ids[:, 10:30], ids[:, 40:], ids[:, :4] = MUG, WALL + 65536, CROWD
    bgr = np.stack([ids >> 16, (ids >> 8) & 255, ids & 255], axis=-1).astype(np.uint8)
    (folder / "predictions").mkdir()
    cv2.imwrite(str(folder / "predictions" / "frame-000000.png"), bgr)
    (folder / "predictions.json").write_text(json.dumps(content))
    return folder / "predictions.json"


def test_what_a_segmenter_wrote_is_mapped(tmp_path: Path) -> None:
    done = convert_coco_panoptic(write(tmp_path, document()), None, tmp_path / "out")
    assert (done.frames, done.segments, done.dropped) == (1, 3, {"crowd": 1, "without_pixels": 1})
    config = PerceptionConfig(profile="precomputed", precomputed=tmp_path / "out")
    result = create_segmenter(config).segment(fakes.fake_frame(), ())
    assert [(s.label.text, s.is_thing, s.score) for s in result.segments] == [("cup", True, 0.75), ("wall", False, 1.0)]
    assert (result.ids[0, [0, 10, 29, 30, 40, 63]] == [0, 1, 1, 0, 2, 2]).all()


def changed(*path: Any, value: Any = None) -> dict[str, Any]:
    """The document with one value replaced, or removed where it is None."""
    whole = document()
    inner: Any = whole
    for key in path[:-1]:
        inner = inner[key]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return whole


SEGMENT = ("annotations", 0, "segments_info", 0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (changed("categories"), "no list 'categories'"),
        ([1, 2], "no list 'images'"),
        (changed("images", 0, "file_name", value="color.jpg"), "expected file names with the frame's index"),
        (changed("images", value=document()["images"] * 2), "one image a frame, found .* for frame 0 again"),
        (changed("annotations", 0, "image_id", value=12), "annotation 0: expected the id of an image, found 12"),
        (changed("annotations", value=document()["annotations"] * 2), "annotation 1: expected one annotation an image"),
        (changed("annotations", 0, "file_name", value="none.png"), "none.png: expected the PNG of an annotation"),
        (changed("annotations", 0, "segments_info"), "annotation 0: expected an object with 'segments_info'"),
        (changed(*SEGMENT, value="seven"), "annotation 0: expected an object with 'id', found seven"),
        (changed(*SEGMENT, "id"), "annotation 0: expected an object with 'id'"),
        (changed(*SEGMENT, "id", value=-1), "expected a positive id, a score from 0 to 1, found id -1"),
        (changed(*SEGMENT, "score", value=7), "found id 7, score 7"),
        (changed(*SEGMENT, "category_id", value=5), "expected a category_id of categories, found 5"),
        (changed("categories", 0, "isthing"), "expected an object with 'isthing'"),
    ],
)
def test_what_does_not_fit_is_named_and_nothing_is_left(tmp_path: Path, content: Any, message: str) -> None:
    file = write(tmp_path, content)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(InputError, match=message):
        convert_coco_panoptic(file, None, tmp_path / "out")
    assert sorted(tmp_path.iterdir()) == before


def test_files_that_are_not_what_they_should_be_are_named(tmp_path: Path) -> None:
    file = write(tmp_path, document())
    image = file.parent / "predictions" / "frame-000000.png"
    cv2.imwrite(str(image), np.zeros((4, 4), np.uint16))
    with pytest.raises(InputError, match=r"frame-000000\.png: expected an 8-bit RGB image, found uint16"):
        convert_coco_panoptic(file, None, tmp_path / "out")
    image.write_bytes(b"no image")
    with pytest.raises(InputError, match="unreadable"):
        convert_coco_panoptic(file, None, tmp_path / "out")
    file.write_text("{")
    with pytest.raises(InputError, match=r"predictions\.json: expected JSON with the lists"):
        convert_coco_panoptic(file, None, tmp_path / "out")
    with pytest.raises(InputError, match="found no such file"):
        convert_coco_panoptic(tmp_path / "none.json", None, tmp_path / "out")


def test_folders_are_checked(tmp_path: Path) -> None:
    file = write(tmp_path, document())
    with pytest.raises(InputError, match="expected a folder of PNG files, found no such folder; use --images"):
        convert_coco_panoptic(file, tmp_path / "nowhere", tmp_path / "out")
    with pytest.raises(InputError, match="expected a new folder"):
        convert_coco_panoptic(file, None, tmp_path)
    with pytest.raises(InputError, match="expected a folder, found nothing there"):
        convert_coco_panoptic(file, None, tmp_path / "a" / "b")
