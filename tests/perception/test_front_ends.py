"""The profiles by name, each on small input, good and bad; and the fakes against their Protocols."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.conftest import shared_data
from tests.perception.scenes import FIRST_BOX, room
from uppm import open_sequence
from uppm.core import protocols
from uppm.core.config import PerceptionConfig
from uppm.core.errors import BadFrameError, ConfigError, InputError
from uppm.core.language import Caption
from uppm.core.shown import Content
from uppm.core.types import Provenance
from uppm.perception import fakes, registry
from uppm.perception.segmentation.embedded import EmbeddedSegmenter

CRATE = ((-0.4, 2.0, 0.0), (0.3, 2.5, 0.4))


@pytest.mark.parametrize(
    ("create", "setting"),
    [
        (registry.create_segmenter, "profile"),
        (registry.create_detector, "detector"),
        (registry.create_mask_generator, "masks"),
    ],
)
def test_an_unknown_name_lists_the_known_ones(create, setting: str) -> None:
    with pytest.raises(ConfigError, match=rf"perception\.{setting}: expected one of .*, found 'nothing'"):
        create(PerceptionConfig.model_validate({setting: "nothing"}))


@pytest.mark.parametrize(
    "table", [registry.SEGMENTERS, registry.DETECTORS, registry.MASK_GENERATORS, registry.VISUAL_ENCODERS]
)
def test_every_name_leads_to_a_class(table: dict[str, str]) -> None:
    for target in table.values():
        module, _, name = target.partition(":")
        assert isinstance(getattr(__import__(module, fromlist=[name]), name), type)


def no_content(seconds: float) -> Content:
    raise AssertionError("nobody watches")


def test_ground_truth_gives_every_instance_once() -> None:
    frame = room([CRATE])
    result = registry.create_segmenter(PerceptionConfig(profile="groundtruth")).segment(frame, ())
    assert [(s.label.text, s.is_thing, s.score) for s in result.segments] == [
        ("floor", False, 1.0), ("wall", False, 1.0), ("box 0", True, 1.0),
    ]  # fmt: skip
    assert all(s.label.provenance is Provenance.GROUND_TRUTH for s in result.segments)
    assert frame.truth is not None
    np.testing.assert_array_equal(result.ids == 3, frame.truth.instance == FIRST_BOX)
    assert result.dropped == {"unlabeled_pixels": 0}


def test_ground_truth_asks_for_it_where_there_is_none() -> None:
    with pytest.raises(InputError, match=r"expected ground truth, found none; use --set perception\.profile=embedded"):
        registry.create_segmenter(PerceptionConfig(profile="groundtruth")).segment(fakes.fake_frame(), ())


def write_precomputed(folder: Path) -> PerceptionConfig:
    ids = np.zeros((48, 64), dtype=np.uint16)
    ids[:, 10:30], ids[:, 40:] = 7, 300
    cv2.imwrite(str(folder / "00000.png"), ids)
    (folder / "labels.csv").write_text("id,label,thing,score\n7,mug,1,0.8\n300,brick wall,0,\n")
    return PerceptionConfig(profile="precomputed", precomputed=folder)


def test_precomputed_segments_are_read(tmp_path: Path) -> None:
    result = registry.create_segmenter(write_precomputed(tmp_path)).segment(fakes.fake_frame(), ())
    assert [(s.label.text, s.is_thing, s.score) for s in result.segments] == [
        ("mug", True, 0.8), ("brick wall", False, 1.0),
    ]  # fmt: skip
    assert (result.ids[0, [0, 10, 29, 30, 40, 63]] == [0, 1, 1, 0, 2, 2]).all()
    assert result.dropped == {"unlabeled_pixels": 20 * 48}


def test_a_frames_own_table_comes_first(tmp_path: Path) -> None:
    config = write_precomputed(tmp_path)
    (tmp_path / "00000.csv").write_text("id, label, thing\n7, teapot, 1\n300, door, 1\n")
    result = registry.create_segmenter(config).segment(fakes.fake_frame(), ())
    assert [s.label.text for s in result.segments] == ["teapot", "door"]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("id,label\n7,mug\n", "no column 'thing'"),
        ("id,label,thing\n7,mug,1\n", "expected a label for id 300"),
        ("id,label,thing\n7,,1\n", "line 2: expected an id from 1 to 65535"),
        ("id,label,thing\nseven,mug,1\n", "line 2: expected numbers"),
        ("id,label,thing,score\n7,mug,1,9\n300,wall,0,1\n", "score of segment 'mug'"),
    ],
)
def test_a_bad_label_table_is_named(tmp_path: Path, table: str, message: str) -> None:
    config = write_precomputed(tmp_path)
    (tmp_path / "labels.csv").write_text(table)
    with pytest.raises(InputError, match=message):
        registry.create_segmenter(config).segment(fakes.fake_frame(), ())


def test_a_bad_id_image_is_named(tmp_path: Path) -> None:
    segmenter = registry.create_segmenter(write_precomputed(tmp_path))
    with pytest.raises(InputError, match=r"00001\.png: expected an id image of this frame, found no such file"):
        segmenter.segment(fakes.fake_frame(1), ())
    with pytest.raises(InputError, match="image of 32x24 pixels"):
        segmenter.segment(fakes.fake_frame(0, 24, 32), ())
    (tmp_path / "00000.png").write_bytes(b"no image")
    with pytest.raises(InputError, match="unreadable"):
        segmenter.segment(fakes.fake_frame(), ())


def test_precomputed_needs_a_folder(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"use --set perception\.precomputed=FOLDER"):
        registry.create_segmenter(PerceptionConfig(profile="precomputed"))
    with pytest.raises(InputError, match="no such folder"):
        registry.create_segmenter(PerceptionConfig(profile="precomputed", precomputed=tmp_path / "none"))


def test_embedded_with_fakes_is_panoptic_and_stateless() -> None:
    config = PerceptionConfig()
    frames = [room([CRATE], pitch=pitch) for pitch in (15, 20, 25)]
    segmenter = EmbeddedSegmenter(config, fakes.FakeDetector("couch"), fakes.FakeMaskGenerator())
    segmenter.prepare(frames)
    first = segmenter.segment(frames[0], ())
    segmenter.segment(frames[2], ())
    again = segmenter.segment(frames[0], ())
    np.testing.assert_array_equal(first.ids, again.ids)
    assert [s.label.text for s in first.segments] == ["couch", "floor", "wall"]
    assert first.dropped["unlabeled_pixels"] == int(((first.ids == 0) & (frames[0].depth > 0)).sum())


def test_embedded_on_the_flat() -> None:
    source = open_sequence(shared_data("data/flat/run1"))
    segmenter = registry.create_segmenter(PerceptionConfig())
    segmenter.prepare([source.frame(i) for i in range(0, len(source), 20)])
    frame = source.frame(60)
    result = segmenter.segment(frame, ())
    names = [s.label.text for s in result.segments]
    assert {"tv", "chair", "floor", "wall"} <= set(names)
    assert frame.truth is not None
    tv = result.ids == names.index("tv") + 1
    truth = np.isin(frame.truth.instance, [i for i, name in frame.truth.names.items() if name == "TV"])
    assert (tv & truth).sum() > 0.8 * (tv | truth).sum()
    assert (result.ids > 0).sum() + result.dropped["unlabeled_pixels"] == (frame.depth > 0).sum()


def test_fakes_meet_their_protocols() -> None:
    source: protocols.FrameSource = fakes.FakeFrameSource(3, bad=[1])
    frame = source.frame(0)
    labeler: protocols.Labeler = fakes.FakeLabeler("mug")
    captioner: protocols.Captioner = fakes.FakeCaptioner("a mug on a table", ["mug"])
    detector: protocols.Detector = fakes.FakeDetector()
    generator: protocols.MaskGenerator = fakes.FakeMaskGenerator()
    segmenter: protocols.Segmenter = fakes.FakeSegmenter()
    encoder: protocols.TextEncoder = fakes.FakeTextEncoder()
    visual: protocols.VisualEncoder = fakes.FakeVisualEncoder()
    retriever: protocols.Retriever = fakes.FakeRetriever({"mug": "cup"})
    voxels: protocols.VoxelSource = fakes.FakeVoxelSource()
    viewer = fakes.FakeFrameViewer()
    assert captioner.caption(frame) == Caption(text="a mug on a table", tags=("mug",))
    found = detector.detect(frame.color, labeler.label(frame).labels)
    assert found.labels[0].text == "mug"
    assert generator.masks(frame, found.boxes)[0].mean() == 0.5
    assert len(segmenter.segment(frame, ()).segments) == 2
    red_and_blue = visual.encode(frame.color, np.array([[0, 0, 32, 48], [32, 0, 64, 48]]))
    np.testing.assert_allclose(red_and_blue, np.eye(3)[[0, 2]], atol=0.01)
    vectors = encoder.encode(["mug", "cup", "mug"])
    np.testing.assert_array_equal(vectors[0], vectors[2])
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(3) + np.eye(3)[[2, 1, 0]] * [1, 0, 1], atol=0.5)
    assert [c.name for c in retriever.retrieve(["mug", "chair", "?"])] == ["cup", "chair", "solid-other"]
    assert len(voxels.blocks(4)) == 1
    protocols_viewer: protocols.FrameViewer = viewer
    protocols_viewer.show(frame, np.zeros((48, 64), np.int32), no_content)
    assert viewer.shown == [0]
    assert len(source) == 3
    with pytest.raises(BadFrameError):
        source.frame(1)
