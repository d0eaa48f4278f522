"""A sequence written as a bag is the same sequence when it is read again."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from tests.datasets.scene import CAMERA, write_frames
from uppm.core.errors import InputError, MissingExtraError
from uppm.datasets import open_sequence
from uppm.perception.fakes import FakeFrameSource

pytest.importorskip("rosbags", reason="pip install uppm[ros] brings rosbags, which writes bags")


def test_what_is_written_is_read(tmp_path: Path) -> None:
    from uppm.datasets.bags.writer import write_bag

    room = open_sequence(write_frames(tmp_path / "room", count=3))
    assert write_bag(room, tmp_path / "bag") == 3
    bag = open_sequence(tmp_path / "bag")
    assert (bag.raw.format, len(bag)) == ("bag", 3)
    for position in range(3):
        frame, wanted = bag.frame(position), room.frame(position)
        np.testing.assert_array_equal(frame.depth, wanted.depth)
        np.testing.assert_allclose(frame.T_map_camera, wanted.T_map_camera, atol=1e-9)
        assert np.abs(frame.color.astype(int) - wanted.color).mean() < 4
        assert frame.stamp == pytest.approx(wanted.stamp, abs=1e-8)
        assert frame.intrinsics == CAMERA


def test_bad_frames_are_left_out_and_nothing_is_left_behind(tmp_path: Path) -> None:
    from uppm.datasets.bags.writer import write_bag

    assert write_bag(FakeFrameSource(3, bad=[0]), tmp_path / "bag") == 2
    with pytest.raises(InputError, match="expected a new folder, found an existing one"):
        write_bag(FakeFrameSource(1), tmp_path / "bag")
    with pytest.raises(InputError, match="fake: expected frames that can be used, found none"):
        write_bag(FakeFrameSource(1, bad=[0]), tmp_path / "none")
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_without_the_library_the_command_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from uppm.datasets.bags.writer import write_bag

    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(MissingExtraError, match=r"pip install uppm\[ros\]"):
        write_bag(FakeFrameSource(1), tmp_path / "bag")
