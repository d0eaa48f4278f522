"""How segments look: from the front end through fusion into the map file, and over an interruption."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest

from tests.cli.room import write_room
from uppm import open_map, open_sequence
from uppm.core.categories import category_by_name
from uppm.core.config import Config, PerceptionConfig
from uppm.core.errors import ConfigError
from uppm.core.protocols import FrameSource
from uppm.core.types import DynamicDescriptor, ElementaryDescriptor, Frame, Provenance
from uppm.fusion.descriptors import merge, observe
from uppm.perception import registry
from uppm.perception.fakes import FakeSegmenter, FakeVisualEncoder, fake_frame
from uppm.perception.featured import WithFeatures, segment_boxes
from uppm.pipeline import map_sequence


class ColorEncoder(FakeVisualEncoder):
    """As a plug-in would be: made from the configuration."""

    def __init__(self, config: PerceptionConfig) -> None:
        self.closed = 0

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def color_encoder(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setitem(registry.VISUAL_ENCODERS, "color", f"{__name__}:ColorEncoder")
    return "color"


def test_boxes_have_a_margin_and_stay_in_the_image() -> None:
    ids = np.zeros((48, 64), dtype=np.int32)
    ids[10:20, 20:40], ids[40:, 60:] = 1, 2
    np.testing.assert_array_equal(segment_boxes(ids, 3), [[18, 9, 42, 21], [59, 39, 64, 48], [0, 0, 64, 48]])


def test_segments_carry_their_feature() -> None:
    encoder = ColorEncoder(PerceptionConfig())
    segmenter = WithFeatures(FakeSegmenter(), encoder)
    segmenter.prepare([fake_frame()])
    left, right = segmenter.segment(fake_frame(), ()).segments
    assert left.feature is not None
    assert right.feature is not None
    assert left.feature[0] > 0.9 > right.feature[0]
    segmenter.close()
    assert encoder.closed == 1


def test_the_setting_chooses(color_encoder: str) -> None:
    assert not isinstance(registry.create_segmenter(PerceptionConfig()), WithFeatures)
    chosen = registry.create_segmenter(PerceptionConfig(visual_feature=color_encoder))
    assert isinstance(chosen, WithFeatures)
    with pytest.raises(ConfigError, match=r"perception\.visual_feature: expected one of clip, .*siglip, found 'x'"):
        registry.create_segmenter(PerceptionConfig(visual_feature="x"))


def seen(*feature: float) -> ElementaryDescriptor:
    vector = np.array(feature, dtype=np.float32) if feature else None
    chair = category_by_name()["chair"]
    return ElementaryDescriptor(label="chair", category=chair, provenance=Provenance.TAG, score=0.5, feature=vector)


def observed(*features: tuple[float, ...]) -> DynamicDescriptor:
    descriptor = None
    for frame, feature in enumerate(features):
        descriptor = observe(descriptor, seen(*feature), frame, 1.0)
    assert descriptor is not None
    return descriptor


def test_the_mean_runs_and_merges() -> None:
    one, two = observed((1, 0), (0, 1), (0, 1)), observed((1, 0))
    assert one.feature is not None
    np.testing.assert_allclose(one.feature.mean, [1 / 3, 2 / 3], atol=1e-6)
    assert one.feature.count == 3
    both = merge(one, two).feature
    assert both is not None
    np.testing.assert_allclose(both.mean, [0.5, 0.5], atol=1e-6)
    assert both.count == 4
    assert observed(()).feature is None
    # A segment without a feature, of an older run say, changes nothing.
    assert observed((1, 0), ()).feature is not None
    assert merge(observed(()), two).feature is two.feature


class Interrupted:
    """A sequence whose reading is broken off after some frames were read."""

    def __init__(self, source: FrameSource, reads: int) -> None:
        self.name, self.indices = source.name, source.indices
        self._source, self._reads = source, reads

    def __len__(self) -> int:
        return len(self._source)

    def frame(self, position: int) -> Frame:
        self._reads -= 1
        if self._reads < 0:
            raise KeyboardInterrupt
        return self._source.frame(position)


def features_in(path: Path) -> list[tuple[int, int, bytes]]:
    with sqlite3.connect(path) as db:
        return db.execute("SELECT submap, count, vector FROM visual_features ORDER BY submap").fetchall()


def test_features_are_in_the_map_and_the_same_after_an_interruption(tmp_path: Path, color_encoder: str) -> None:
    source = open_sequence(write_room(tmp_path / "room"))
    settings = [
        "perception.profile=groundtruth",
        f"perception.visual_feature={color_encoder}",
        "map.checkpoint_every=3",
    ]
    config = Config.load(None, settings)
    map_sequence(source, tmp_path / "whole.uppm", config)
    with pytest.raises(KeyboardInterrupt):
        # Twelve are read for gravity, before the first is mapped.
        map_sequence(Interrupted(source, 12 + 7), tmp_path / "broken.uppm", config)
    map_sequence(source, tmp_path / "broken.uppm", resume=True)
    whole = features_in(tmp_path / "whole.uppm")
    assert len(whole) >= 5
    assert features_in(tmp_path / "broken.uppm") == whole
    described = [s for s in open_map(tmp_path / "whole.uppm").submaps if s.descriptor]
    for submap in described:
        assert submap.descriptor is not None
        assert submap.descriptor.feature is not None
        assert submap.descriptor.feature.mean.shape == (3,)
        assert submap.descriptor.feature.count == submap.views


def test_a_map_without_features_has_no_table_for_them(tmp_path: Path) -> None:
    source = open_sequence(write_room(tmp_path / "room", 3))
    map_sequence(source, tmp_path / "m.uppm", Config.load(None, ["perception.profile=groundtruth"]))
    with sqlite3.connect(tmp_path / "m.uppm") as db:
        assert not db.execute("SELECT 1 FROM sqlite_master WHERE name = 'visual_features'").fetchone()
    assert all(s.descriptor.feature is None for s in open_map(tmp_path / "m.uppm").submaps if s.descriptor)
