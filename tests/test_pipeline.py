"""The Python interface as the README shows it, with stand-ins for what perceives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import uppm
from tests.cli.room import NAMES, write_room
from uppm.core.errors import BadFrameError, ConfigError, InputError, MapFileError
from uppm.core.language import FrameLabels
from uppm.core.types import SubmapKind
from uppm.map.store import MapMeta
from uppm.perception.fakes import (
    FakeFrameSource,
    FakeFrameViewer,
    FakeLabeler,
    FakeRetriever,
    FakeSegmenter,
    fake_frame,
)
from uppm.pipeline import saved_config, spread_frames

CONFIG = uppm.Config.load(None, ["perception.profile=groundtruth", "map.checkpoint_every=2"])


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_room(tmp_path_factory.mktemp("pipeline") / "room", count=6)


def test_frames_one_by_one() -> None:
    segmenter, viewer = FakeSegmenter("mug", "wall"), FakeFrameViewer()
    mapper = uppm.Mapper(segmenter=segmenter, retriever=FakeRetriever({"mug": "cup"}), viewer=viewer)
    mapper.prepare([fake_frame(0)])
    images = [mapper.integrate(fake_frame(i)) for i in range(4)]
    mapper.finish()
    assert (segmenter.prepared, viewer.shown) == (1, [0, 1, 2, 3])
    assert images[-1].shape == (48, 64)
    assert images[-1].dtype == np.int32
    found = mapper.map
    cup = found.query("mug").results[0].submap
    assert (cup.id, cup.kind) == (images[-1][24, 16], SubmapKind.OBJECT)
    assert cup.descriptor is not None
    assert (cup.descriptor.category.name, cup.descriptor.labels[0].text, cup.descriptor.labels[0].count) == (
        "cup",
        "mug",
        4,
    )
    # The wall is 2 m ahead; the camera stands at the origin.
    assert cup.center[2] == pytest.approx(2, abs=0.03)
    assert found.report.frames == 4
    assert [f.index for f in found.frames] == [0, 1, 2, 3]
    assert {"perception", "retrieval", "fusion", "finish"} <= set(found.report.seconds)
    assert np.asarray(found.mesh().vertices)[:, 2] == pytest.approx(2, abs=0.05)


def test_a_frame_that_the_labeler_refuses_is_counted_and_not_fused() -> None:
    class Choosy:
        def label(self, frame):
            return FrameLabels(dropped={"label is no object": 2}, skip="blurred" if frame.index else None)

    mapper = uppm.Mapper(labeler=Choosy(), segmenter=FakeSegmenter(), retriever=FakeRetriever())
    assert mapper.integrate(fake_frame(0)).any()
    assert not mapper.integrate(fake_frame(1)).any()
    assert (mapper.report.frames, mapper.report.skipped) == (1, {"blurred": 1})
    assert mapper.report.dropped["label is no object"] == 4
    assert [record.skipped for record in mapper.map.frames] == [None, "blurred"]


def test_labels_reach_the_segmenter() -> None:
    seen = []

    class Listening(FakeSegmenter):
        def segment(self, frame, labels=()):
            seen.append([label.text for label in labels])
            return super().segment(frame, labels)

    mapper = uppm.Mapper(labeler=FakeLabeler("mug", "spoon"), segmenter=Listening(), retriever=FakeRetriever())
    mapper.integrate(fake_frame())
    assert seen == [["mug", "spoon"]]


def test_a_map_is_as_it_was_when_it_was_asked_for() -> None:
    mapper = uppm.Mapper(segmenter=FakeSegmenter(), retriever=FakeRetriever())
    mapper.integrate(fake_frame(0))
    before = mapper.map
    mapper.integrate(fake_frame(1))
    assert (before.report.frames, len(before.frames)) == (1, 1)
    assert (mapper.map.report.frames, len(mapper.map.frames)) == (2, 2)


def test_a_frame_of_another_kind_is_refused() -> None:
    frame = fake_frame()
    with pytest.raises(InputError, match="depth"):
        uppm.Frame(
            index=0,
            stamp=0.0,
            color=frame.color,
            depth=frame.depth.astype(np.float64),  # pyright: ignore[reportArgumentType]
            T_map_camera=frame.T_map_camera,
            intrinsics=frame.intrinsics,
        )


def test_from_sequence_to_answers(room: Path, tmp_path: Path) -> None:
    path = tmp_path / "room.uppm"
    steps: list[tuple[int, int]] = []
    report = uppm.map_sequence(
        uppm.open_sequence(room), path, CONFIG, progress=lambda done, total: steps.append((done, total))
    )
    assert report.frames == 6
    assert steps == [(i, 6) for i in range(1, 7)]
    found = uppm.open_map(path)
    assert found.query("ball").results[0].label == "sports ball"
    assert not found.query("airplane").found
    assert {s.descriptor.category.name for s in found.submaps if s.descriptor} == set(NAMES)
    assert saved_config(found.meta) == CONFIG
    assert (found.meta.provenance["sequence"], found.meta.provenance["frames"]) == ("room", "6")
    assert found.up == pytest.approx([0, 0, 1], abs=0.05)
    assert found.report == report


def test_a_mapper_and_its_file_hold_the_same_map(room: Path, tmp_path: Path) -> None:
    source = uppm.open_sequence(room)
    mapper = uppm.Mapper(CONFIG)
    mapper.prepare(spread_frames(source))
    for position in range(len(source)):
        mapper.integrate(source.frame(position))
    mapper.finish()
    uppm.map_sequence(source, tmp_path / "room.uppm", CONFIG)
    live, saved = mapper.map.to_dict(), uppm.open_map(tmp_path / "room.uppm").to_dict()
    assert live["submaps"] == saved["submaps"]
    assert live["up"] == saved["up"]
    assert live["report"]["dropped"] == saved["report"]["dropped"]


def test_bad_frames_are_skipped_unless_strict(tmp_path: Path) -> None:
    source, path = FakeFrameSource(6, bad=[0, 3]), tmp_path / "fake.uppm"
    config = uppm.Config.load(None, ["map.checkpoint_every=1", "fusion.depth_max=4"])
    report = uppm.map_sequence(source, path, config)
    assert (report.frames, report.skipped) == (4, {"a bad one": 2})
    frames = uppm.open_map(path).frames
    assert [(f.index, f.skipped) for f in frames if f.skipped] == [(0, "a bad one"), (3, "a bad one")]
    strict = uppm.Config.load(None, ["input.strict=true", "map.checkpoint_every=1"])
    before = path.read_bytes()
    with pytest.raises(BadFrameError, match="frame 0"):
        uppm.map_sequence(source, path, strict, overwrite=True)
    assert path.read_bytes() == before
    with pytest.raises(MapFileError, match="--overwrite"):
        uppm.map_sequence(source, path, config)


def test_no_usable_frame_writes_no_map(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fake: expected frames that can be used, found 3 with a bad one"):
        uppm.map_sequence(FakeFrameSource(3, bad=[0, 1, 2]), tmp_path / "fake.uppm", uppm.Config())
    assert list(tmp_path.iterdir()) == []


def test_resume_refuses_another_sequence(room: Path, tmp_path: Path) -> None:
    path = tmp_path / "room.uppm"
    uppm.map_sequence(uppm.open_sequence(room), path, CONFIG)
    with pytest.raises(InputError, match=r"\(room, 6 frames\), found fake, 6 frames"):
        uppm.map_sequence(FakeFrameSource(6), path, resume=True)


def test_settings_of_another_version() -> None:
    with pytest.raises(ConfigError, match=r"found fusion\.warp: extra inputs"):
        saved_config(MapMeta(config='{"fusion": {"warp": 9}}'))


def test_frames_spread_over_a_sequence() -> None:
    assert [f.index for f in spread_frames(FakeFrameSource(30), 4)] == [0, 9, 19, 29]
    assert [f.index for f in spread_frames(FakeFrameSource(3, bad=[1]), 12)] == [0, 2]
