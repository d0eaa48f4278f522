"""Record3D's zip: what may differ between recordings, and what is wrong with one."""

from __future__ import annotations

import json
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("lzfse", reason="pip install uppm[record3d] brings lzfse, with which .r3d files are written here")
from lzfse import compress

import uppm
from tests.datasets import formats, scene
from tests.datasets.test_bad_input import bad_frame, refused
from uppm.core.errors import MissingExtraError
from uppm.datasets import check_sequence, open_sequence

Members = dict[str, bytes]


def changed(path: Path, change: Callable[[Members], object]) -> Path:
    """The zip file with other members."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    change(members)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def test_it_passes_the_check_and_maps(tmp_path: Path) -> None:
    source = open_sequence(formats.record3d(tmp_path / "room"))
    result = check_sequence(source)
    assert result.ok, result.findings
    config = uppm.Config.load(None, ["fusion.max_blocks=20000"])
    uppm.map_sequence(source, tmp_path / "room.uppm", config)
    assert len(uppm.open_map(tmp_path / "room.uppm").mesh().faces) > 1000


def test_what_may_differ_between_recordings(tmp_path: Path) -> None:
    times = [5.0, 5.2, 5.3, 5.5]
    source = open_sequence(formats.record3d(tmp_path / "room", columns=False, frameTimestamps=times))
    assert source.raw.color == scene.CAMERA
    assert [source.frame(i).stamp for i in range(4)] == times


def test_depth_of_low_confidence_is_left_out(tmp_path: Path) -> None:
    confidence = np.full((60, 80), 1, np.uint8)
    confidence[:, :40] = 0

    def lower(members: Members) -> None:
        members["rgbd/1.conf"] = compress(confidence.tobytes())
        del members["rgbd/2.conf"]

    source = open_sequence(changed(formats.record3d(tmp_path / "room"), lower))
    seen = [source.frame(i).depth > 0 for i in range(3)]
    assert not seen[1][:, :78].any()
    assert seen[1][:, 82:].mean() > 0.9
    assert seen[2].mean() > 0.9


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: m.pop("metadata"), "expected metadata and rgbd/ in the zip file"),
        (lambda m: m.update(metadata=b"{"), "expected metadata in JSON"),
        (lambda m: m.update(metadata=b'{"w": 160}'), "found none of K, h"),
        (lambda m: m.update(metadata=b"[]"), "found none of K, h, w"),
        (lambda m: [m.pop(name) for name in list(m) if name.endswith(".jpg")], "found no colour image"),
    ],
)
def test_a_damaged_file_is_one_line(tmp_path: Path, change: Callable[[Members], object], said: str) -> None:
    assert said in refused(changed(formats.record3d(tmp_path / "room"), change))


@pytest.mark.parametrize(
    ("metadata", "said"),
    [
        ({"poses": []}, "expected poses in the metadata, found none; record with the LiDAR camera"),
        ({"poses": [[1, 2]]}, "expected poses of any count x 7 numbers"),
        ({"K": [1, 2, 3]}, "expected K of 3 x 3 numbers"),
        ({"dw": 9}, "expected depth images of 9x60, found 4800 values"),
    ],
)
def test_wrong_metadata_is_one_line(tmp_path: Path, metadata: dict[str, Any], said: str) -> None:
    assert said in refused(formats.record3d(tmp_path / "room", **metadata))


def test_a_frame_that_is_damaged_is_a_bad_frame(tmp_path: Path) -> None:
    path = formats.record3d(tmp_path / "room")
    for data in (b"", b"bvx2 and no more", compress(b"short")):
        error = bad_frame(changed(path, lambda members, data=data: members.update({"rgbd/1.depth": data})))
        assert error.found == "a truncated or unreadable image"
    assert bad_frame(changed(path, lambda members: members.pop("rgbd/1.depth"))).found == "a missing file"

    def fewer_poses(members: Members) -> None:
        about = json.loads(members["metadata"])
        members["metadata"] = json.dumps(about | {"poses": about["poses"][:2]}).encode()

    assert bad_frame(changed(path, fewer_poses), index=2).found == "no pose"


def test_without_the_library_the_command_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = formats.record3d(tmp_path / "room")
    monkeypatch.setitem(sys.modules, "lzfse", None)
    with pytest.raises(MissingExtraError, match=r"pip install uppm\[record3d\]"):
        open_sequence(path)


def test_what_is_no_zip_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "room.r3d").write_bytes(b"something")
    assert "expected a zip file, found File is not a zip file" in refused(tmp_path / "room.r3d")
