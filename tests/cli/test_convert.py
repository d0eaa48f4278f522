"""`uppm convert coco-panoptic`, and a map of what it wrote."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from tests.cli.conftest import Uppm
from tests.cli.room import COUNT, NAMES


def write_coco(folder: Path, room: Path) -> Path:
    """The room's instances in COCO's panoptic format."""
    annotations = []
    for file in sorted((room / "instance").iterdir()):
        ids = np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), dtype=np.uint8)
        cv2.imwrite(str(folder / file.name), np.stack([np.zeros_like(ids), np.zeros_like(ids), ids], axis=-1))
        segments = [{"id": int(i), "category_id": int(i), "iscrowd": 0} for i in np.unique(ids) if i]
        annotations.append({"image_id": file.stem, "file_name": file.name, "segments_info": segments})
    document = {
        "images": [{"id": a["image_id"], "file_name": a["image_id"] + ".jpg"} for a in annotations],
        "annotations": annotations,
        "categories": [{"id": k, "name": name, "isthing": int(k > 3)} for k, name in enumerate(NAMES, 1)],
    }
    (folder / "panoptic.json").write_text(json.dumps(document))
    return folder / "panoptic.json"


def test_converted_segments_are_mapped(uppm: Uppm, whole_room: Path, tmp_path: Path) -> None:
    folder = tmp_path / "segments"
    done = uppm("convert", "coco-panoptic", write_coco(tmp_path, whole_room), "-o", folder, "--json")
    assert done.code == 0
    told = json.loads(done.out)
    assert told["frames"] == COUNT
    assert told["dropped"] == {}
    output = tmp_path / "room.uppm"
    mapped = uppm("map", whole_room, "-o", output, "--perception", "precomputed", "--precomputed", folder, "--json")
    assert mapped.code == 0, mapped.err
    names = {s["category"] for s in json.loads(uppm("info", output, "--json").out)["submaps"]}
    assert {"sports ball", "orange", "floor-wood"} <= names


def test_a_second_run_does_not_overwrite(uppm: Uppm, whole_room: Path, tmp_path: Path) -> None:
    file = write_coco(tmp_path, whole_room)
    first = uppm("convert", "coco-panoptic", file, "-o", tmp_path / "segments")
    assert first.out.startswith(f"{tmp_path / 'segments'}: {COUNT} frames")
    again = uppm("convert", "coco-panoptic", file, "-o", tmp_path / "segments")
    assert (again.code, again.err.count("\n")) == (2, 1)
    assert "expected a new folder, found an existing one" in again.err
