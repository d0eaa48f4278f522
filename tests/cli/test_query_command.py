"""`uppm query` as a user types it: questions, viewpoints, and what is wrong with them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Uppm


def test_a_phrase_lists_what_matches(uppm: Uppm, map_file: Path) -> None:
    done = uppm("query", map_file, "sports ball")
    assert (done.code, done.err) == (0, "")
    assert "sports ball" in done.out
    assert "nothing here matches" in uppm("query", map_file, "zebra").out


def test_a_question_says_how_it_was_understood_and_why_things_answer(uppm: Uppm, map_file: Path) -> None:
    done = uppm("query", map_file, "what is the largest thing", "--json")
    reply = json.loads(done.out)
    assert reply["understood"] == "largest thing"
    assert reply["count"] == 1
    assert reply["results"][0]["reasons"][0].startswith("largest of 2: ")
    table = uppm("query", map_file, "what is the largest thing").out
    assert "understood as: largest thing" in table
    assert "largest of 2" in " ".join(table.split())


def test_a_count_is_a_number(uppm: Uppm, map_file: Path) -> None:
    assert uppm("query", map_file, "how many oranges").out.splitlines()[:2] == ["understood as: how many: oranges", "1"]
    nothing = json.loads(uppm("query", map_file, "how many zebras", "--json").out)
    assert (nothing["found"], nothing["count"], nothing["note"]) == (False, 0, "nothing here matches 'zebras'")


def test_the_viewpoint_decides_what_is_nearest(uppm: Uppm, map_file: Path) -> None:
    found = {}
    objects = [s for s in json.loads(uppm("info", map_file, "--json").out)["submaps"] if s["kind"] == "object"]
    for submap in objects:
        place = ",".join(f"{value:.3f}" for value in submap["center"])
        reply = json.loads(uppm("query", map_file, "nearest thing", f"--from={place}", "--json").out)
        (first,) = reply["results"]
        found[submap["id"]] = first["id"]
        assert "m from the viewpoint" in first["reasons"][0]
    assert len(found) == 2
    assert all(asked == nearest for asked, nearest in found.items())
    camera = json.loads(uppm("query", map_file, "nearest thing", "--json").out)
    assert "m from the last camera" in camera["results"][0]["reasons"][0]


def test_what_is_not_understood_is_searched_and_says_so(uppm: Uppm, map_file: Path) -> None:
    done = uppm("query", map_file, "orange nearest to", "--json")
    assert done.code == 0
    assert json.loads(done.out)["note"] == "not understood, searched as a plain phrase"


@pytest.mark.parametrize("point", ["1,2", "1,2,x", "", "1;2;3", "nan,0,0", "1,2,inf", "1,2,3,4"])
def test_a_wrong_viewpoint_is_one_line(uppm: Uppm, map_file: Path, point: str) -> None:
    done = uppm("query", map_file, "nearest thing", f"--from={point}")
    assert done.code == 2
    said = f"error: --from: expected three numbers with commas between them, found {point!r}; write metres in frame map"
    assert done.err.startswith(said)
    assert done.err.count("\n") == 1


def test_an_empty_phrase_and_a_missing_map_are_one_line(uppm: Uppm, map_file: Path, tmp_path: Path) -> None:
    assert "query: expected a phrase such as 'coffee mug', found ' '" in uppm("query", map_file, " ").err
    assert "expected a map file, found nothing there" in uppm("query", tmp_path / "no.uppm", "cup").err
