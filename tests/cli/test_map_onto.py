"""`uppm map --onto`: what became of an older map's objects, on the room seen twice."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Uppm

GROUND_TRUTH = ("--perception", "groundtruth")


@pytest.mark.parametrize("align", [(), ("--align",)])
def test_the_same_room_twice(uppm: Uppm, whole_room: Path, map_file: Path, tmp_path: Path, align: tuple) -> None:
    path = tmp_path / "again.uppm"
    done = uppm("map", whole_room, "-o", path, *GROUND_TRUTH, "--onto", map_file, *align, "--json")
    assert done.code == 0, done.err
    changes = json.loads(done.out)["changes"]
    assert {change["state"] for change in changes} == {"persistent"}
    assert sorted(change["label"] for change in changes) == ["orange", "sports ball"]
    assert json.loads(uppm("info", path, "--json").out)["changes"] == changes
    shown = uppm("info", path).out
    assert "2 persistent" in shown
    assert ("aligned" in shown) == bool(align)
    assert "persistent" not in uppm("info", map_file).out


@pytest.mark.parametrize(
    ("options", "said"),
    [(("--align",), "--onto"), (("--onto", "none.uppm"), "none.uppm"), (("--onto", "MAP"), "same file")],
)
def test_wrong_options_end_before_mapping(
    uppm: Uppm, whole_room: Path, map_file: Path, tmp_path: Path, options: tuple[str, ...], said: str
) -> None:
    target = map_file if "MAP" in options else tmp_path / "new.uppm"
    options = tuple(str(map_file) if option == "MAP" else option for option in options)
    before = target.read_bytes() if target.exists() else None
    done = uppm("map", whole_room, "-o", target, *GROUND_TRUTH, "--overwrite", *options)
    assert done.code == 2
    assert said in done.err
    assert (target.read_bytes() if target.exists() else None) == before
