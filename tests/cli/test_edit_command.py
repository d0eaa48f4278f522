"""`uppm edit` as a user types it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.cli.conftest import Uppm


@pytest.fixture
def path(map_file: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(map_file, tmp_path / "room.uppm"))


def ids(uppm: Uppm, path: Path) -> dict[str, int]:
    """First label -> submap."""
    submaps = json.loads(uppm("info", path, "--json").out)["submaps"]
    return {next(iter(s["labels"])): s["id"] for s in submaps if s["labels"]}


def test_edit_list_and_undo(uppm: Uppm, path: Path) -> None:
    before = ids(uppm, path)
    ball, orange = before["sports ball"], before["orange"]
    done = uppm("edit", path, "--rename", f"{ball}=globe", "--delete", orange, "--by", "ann")
    assert (done.code, done.err) == (0, "")
    first, second = done.out.splitlines()
    assert first.startswith(f"1. submap {ball}, sports ball (sports ball): called globe (")
    assert first.endswith(" by ann)")
    assert second.startswith(f"1. submap {orange}, orange (orange): deleted (")
    after = ids(uppm, path)
    assert after["globe"] == ball
    assert "orange" not in after
    assert "2 corrections by hand" in uppm("info", path).out
    listed = json.loads(uppm("edit", path, "--json").out)
    assert [(c["action"], c["author"], c["before"]["category"]) for c in listed] == [
        ("rename", "ann", "sports ball"),
        ("delete", "ann", "orange"),
    ]
    assert uppm("edit", path, "--undo", "--by", "bob").out.count("undone: 1. submap") == 2
    assert ids(uppm, path) == before
    assert " by bob)" in uppm("edit", path).out


def test_merge_and_category(uppm: Uppm, path: Path) -> None:
    before = ids(uppm, path)
    ball, orange = before["sports ball"], before["orange"]
    done = uppm("edit", path, "--category", f"{ball}=apple", "--merge", f"{ball}={orange}")
    took_in, pinned = done.out.splitlines()
    assert f"took in submap {orange}, orange" in took_in
    assert "category apple" in pinned
    (kept,) = [s for s in json.loads(uppm("info", path, "--json").out)["submaps"] if s["id"] == ball]
    assert set(kept["labels"]) == {"sports ball", "orange"}
    assert (kept["category"], kept["confidence"]) == ("apple", 1)
    assert uppm("edit", path, "--undo").code == 0


def test_a_map_without_corrections_says_so(uppm: Uppm, path: Path) -> None:
    assert uppm("edit", path).out == "nothing was corrected by hand\n"
    assert json.loads(uppm("edit", path, "--json").out) == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--rename", "ball=globe"], "--rename: expected ID=VALUE, found 'ball=globe'"),
        (["--category", "5"], "--category: expected ID=VALUE, found '5'"),
        (["--category", "5=couchh"], "--category: expected a unified category, found 'couchh'; did you mean couch"),
        (["--merge", "5=here"], "--merge: expected the ids of two submaps, KEPT=OTHER, found '5=here'"),
        (["--delete", "999"], "submap 999: expected the id of an object or piece of background, found none such"),
        (["--undo"], "expected a correction to undo, found none"),
        (["--undo", "--delete", "5"], "--undo: expected no other edit beside it"),
    ],
)
def test_wrong_edits_are_one_line_and_change_nothing(uppm: Uppm, path: Path, options: list[str], said: str) -> None:
    before = path.read_bytes()
    done = uppm("edit", path, *options)
    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1
    assert path.read_bytes() == before
