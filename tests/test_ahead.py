"""Perception that runs ahead of fusion, and keyframes with masks carried by the map, through `map_sequence`."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from tests.cli.room import write_room
from tests.test_resume import assert_same_map, unbroken
from uppm.core.config import Config
from uppm.core.parallel import run_ahead
from uppm.pipeline import map_sequence, open_map, open_sequence

SETTINGS = ("perception.profile=groundtruth", "map.checkpoint_every=3")


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_room(tmp_path_factory.mktemp("ahead") / "room", count=8)


def test_results_come_in_order_and_one_item_ahead() -> None:
    threads: set[str] = set()
    started: list[int] = []

    def square(n: int) -> int:
        threads.add(threading.current_thread().name)
        started.append(n)
        if n == 2:
            raise ValueError("two")
        return n * n

    for ahead in (False, True):
        started.clear()
        found: list[int | str] = []
        for n, result in run_ahead(square, range(5), ahead=ahead):
            assert set(started) <= set(range(n + 2))
            try:
                found.append(result())
            except ValueError as error:
                found.append(str(error))
        assert found == [0, 1, "two", 9, 16]
    assert len(threads) == 2
    assert list(run_ahead(square, [], ahead=True)) == []


def test_the_map_is_the_same_when_perception_runs_ahead(room: Path, tmp_path: Path) -> None:
    one = unbroken(room, tmp_path / "one.uppm", *SETTINGS)
    other = unbroken(room, tmp_path / "other.uppm", *SETTINGS, "perception.ahead=true")
    assert_same_map(one, other)


def test_between_keyframes_the_map_labels_the_frame(room: Path, tmp_path: Path) -> None:
    every = open_map(unbroken(room, tmp_path / "every.uppm", *SETTINGS))
    keyed = [
        *SETTINGS,
        "perception.keyframe=motion",
        "perception.keyframe_translation=9",
        "perception.keyframe_rotation=180",
    ]
    path = unbroken(room, tmp_path / "keyed.uppm", *keyed, "perception.keyframe_novelty=1")
    found = open_map(path)
    carried = found.report.dropped["frame between keyframes"]
    assert (found.report.frames, carried) == (8, 5)  # frames 0, 3 and 6 begin a checkpoint
    names = [{s.descriptor.category.name for s in m.submaps if s.descriptor} for m in (every, found)]
    assert names[0] == names[1]
    assert max(s.views for s in found.submaps if s.descriptor) == 3
    points = [sum(len(m.submap_mesh(s.id).vertices) for s in m.submaps if s.descriptor) for m in (every, found)]
    assert points[1] > 0.8 * points[0]
    assert_same_map(
        path, unbroken(room, tmp_path / "ahead.uppm", *keyed, "perception.keyframe_novelty=1", "perception.ahead=true")
    )


@pytest.mark.parametrize("ahead", [False, True])
def test_a_broken_run_with_keyframes_goes_on_as_if_unbroken(room: Path, tmp_path: Path, ahead: bool) -> None:
    """Keyframes 0, 3 and 6 begin a checkpoint; the run breaks off between two, at one frame behind a keyframe."""
    keyed = ("keyframe=motion", "keyframe_translation=9", "keyframe_rotation=180", "keyframe_novelty=1")
    settings = (*SETTINGS, *(f"perception.{setting}" for setting in keyed), f"perception.ahead={ahead}")
    whole, path = unbroken(room, tmp_path / "whole.uppm", *settings), tmp_path / "broken.uppm"
    config = Config.load(None, settings)
    source, mapped = open_sequence(room, config.input), list[int]()

    def stop(done: int, total: int) -> None:
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        map_sequence(source, path, config, progress=stop)
    map_sequence(source, path, resume=True, progress=lambda done, total: mapped.append(done))
    assert mapped == [4, 5, 6, 7, 8]
    assert_same_map(whole, path)
