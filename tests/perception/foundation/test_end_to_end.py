"""From pictures to a map file, with each back end chosen by its name in the configuration and tiny random weights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.perception.foundation import tiny
from tests.perception.foundation.conftest import noisy
from uppm import open_map
from uppm.core.config import Config
from uppm.core.types import Frame
from uppm.perception import registry
from uppm.perception.fakes import FakeLabeler, fake_frame
from uppm.perception.models.network import Network
from uppm.perception.models.table import MODELS
from uppm.pipeline import Mapper, map_sequence

Models = Callable[..., Path]
SETTINGS = {
    "detector": "detector_model",
    "masks": "masks_model",
    "profile": "segmenter_model",
    "visual_feature": "visual_feature_model",
}
"""Part of perception -> the setting that names its model."""
LABELS = ("chair", "cup", "wall")
"""Whose embeddings ship with the package."""


class Pictures:
    """FrameSource of three noisy pictures of a wall."""

    name, indices = "pictures", range(3)

    def __len__(self) -> int:
        return len(self.indices)

    def frame(self, position: int) -> Frame:
        return noisy(fake_frame(position))


def configuration(**perception: Any) -> Config:
    every = {"detector_score": 0.0, "text_score": 0.0, "threads": 1, "min_mask_pixels": 1} | perception
    fusion = {"confirm_evidence": 0.0, "min_surface": 1, "min_area": 0.0}
    return Config.model_validate({"perception": every, "fusion": fusion})


CHOSEN: list[dict[str, Any]] = [
    {"detector": "grounding_dino", "masks": "sam"},
    {
        "detector": "grounding_dino",
        "detector_model": "grounding-dino-base",
        "masks": "sam",
        "masks_model": "sam-vit-huge",
    },
    {"detector": "mm_grounding_dino", "masks": "sam2"},
    {"detector": "owlv2", "masks": "mobile_sam"},
    {"detector": "owlvit", "masks": "sam", "masks_model": "sam-vit-large", "nms": "classic"},
    {"detector": "owlvit", "masks": "sam", "masks_model": "slimsam-50", "nms": "none"},
    {"detector": "owlvit", "masks": "sam", "masks_model": "slimsam-77", "visual_feature": "clip"},
    {"detector": "owlvit", "masks": "sam2", "masks_model": "sam2.1-hiera-small"},
    {"detector": "owlvit", "masks": "sam2", "masks_model": "sam2.1-hiera-base-plus"},
    {"detector": "owlvit", "masks": "sam2", "masks_model": "sam2.1-hiera-large"},
    {"profile": "foundation-light", "masks_side": 64},
    {"profile": "mask2former", "visual_feature": "clip", "visual_feature_model": "clip-vit-large"},
    {"profile": "mask2former", "segmenter_model": "mask2former-swin-large"},
    {"profile": "oneformer", "visual_feature": "siglip"},
    {"profile": "sam3"},
]
"""Back ends and sizes by their names in the configuration, each in one at least; `foundation` if no profile is said."""
OF_CAPTIONERS = {"tag2text", "ram_plus", "florence2", "ram_plus_tags", "retrieval"}
"""What needs the other models: `tests/perception/captioners`, `tests/perception/retrieval`."""


def whole(chosen: dict[str, Any]) -> dict[str, Any]:
    """The settings, with the names of the models whose place tiny networks take."""
    settings = {"profile": "foundation", "captioner": "none", "masks": "box", **chosen}
    if settings["profile"] == "foundation-light":
        settings |= {"detector": "owlvit", "masks": "sam2"}
    for part, setting in SETTINGS.items():
        if settings.get(part) in tiny.NAMES:
            settings.setdefault(setting, tiny.NAMES[settings[part]])
    return settings


def test_every_back_end_and_every_model_has_its_run() -> None:
    """So that none that comes later is forgotten."""
    runs = [whole(chosen) for chosen in CHOSEN]
    models = {settings[setting] for settings in runs for setting in SETTINGS.values() if setting in settings}
    assert models == {name for name, spec in MODELS.items() if spec.back_end not in OF_CAPTIONERS}
    names = {part: {settings.get(part) for settings in runs} for part in SETTINGS}
    assert names["detector"] >= registry.DETECTORS.keys() - {"nanodet"}
    assert names["masks"] >= registry.MASK_GENERATORS.keys() - {"geometric", "box"}
    assert names["visual_feature"] >= registry.VISUAL_ENCODERS.keys()
    of_no_network = {"embedded", "groundtruth", "precomputed", "simulated"}
    assert names["profile"] == registry.SEGMENTERS.keys() - of_no_network


@pytest.mark.heavy
@pytest.mark.parametrize("chosen", CHOSEN, ids=lambda chosen: "-".join(map(str, chosen.values())))
def test_a_back_end_by_name_makes_a_map(models: Models, chosen: dict[str, Any]) -> None:
    settings = whole(chosen)
    for part, setting in SETTINGS.items():
        if settings.get(part) in tiny.NAMES:
            models(settings[part], settings[setting])
    mapper = Mapper(configuration(**settings), labeler=FakeLabeler(*LABELS))
    for frame in map(Pictures().frame, range(3)):
        mapper.integrate(frame)
    mapper.finish()
    mapper.close()
    described = [s.descriptor for s in mapper.map.submaps if s.descriptor]
    assert all((d.feature is not None) is ("visual_feature" in chosen) for d in described)
    said = {record.text for d in described for record in d.labels}
    assert said
    closed_set = {"ceiling-other", "chair", "wall-other", "cup"}
    assert said <= (closed_set if settings["profile"] in ("mask2former", "oneformer") else set(LABELS))
    assert mapper.report.dropped.get("unlabeled_pixels", 0) < 3 * 48 * 64


@pytest.mark.heavy
@pytest.mark.parametrize("precision", ["float16", "bfloat16"])
def test_every_network_runs_in_half_precision(models: Models, precision: str) -> None:
    """As a GPU runs them by default: what one part makes in single precision must not meet another in half."""
    frame, said = noisy(fake_frame()), FakeLabeler("chair").label(fake_frame()).labels
    boxes = np.array([[0, 0, 30, 40], [20, 10, 60, 48]], dtype=np.float32)
    for kind, name in tiny.NAMES.items():
        models(kind)
        chosen = {"detector": kind, "masks": kind, "profile": kind, "visual_feature": kind}
        every = dict.fromkeys(("detector_model", "masks_model", "segmenter_model", "visual_feature_model"), name)
        config = configuration(precision=precision, **chosen, **every).perception
        if kind in registry.DETECTORS:
            found = registry.create_detector(config).detect(frame.color, said)
            assert len(found.labels)
            assert np.isfinite(found.boxes).all()
        elif kind in registry.MASK_GENERATORS:
            assert 0.02 < registry.create_mask_generator(config).masks(frame, boxes).mean() < 0.98
        elif kind in registry.VISUAL_ENCODERS:
            vectors = registry.create_visual_encoder(config).encode(frame.color, boxes.astype(int))
            np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
        else:
            alone = config.model_copy(update={"visual_feature": "none"})
            assert registry.create_segmenter(alone).segment(frame, said).ids.shape == frame.depth.shape


@pytest.mark.heavy
def test_memory_that_ends_costs_a_warning_and_no_frame(
    models: Models, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a GPU that is full at the second frame; the CPU plays its part. A smaller SAM goes on."""
    torch, t = tiny.torch_or_skip()
    models("owlvit")
    for name in ("sam-vit-large", "sam-vit-base"):
        models("sam", name)
    sizes = {"sam-vit-large": ["sam-vit-large", "sam-vit-base"]}
    monkeypatch.setattr(
        Network, "_ladder", lambda self, name: ((size, torch.device("cpu")) for size in sizes.get(name, [name]))
    )
    embed, asked = t.SamModel.get_image_embeddings, list[int]()

    def full_at_the_second(self: Any, pixels: Any) -> Any:
        asked.append(len(asked))
        if len(asked) == 2:
            raise torch.OutOfMemoryError("no room")
        return embed(self, pixels)

    monkeypatch.setattr(t.SamModel, "get_image_embeddings", full_at_the_second)
    chosen = whole({"detector": "owlvit", "masks": "sam", "masks_model": "sam-vit-large", "captioner": "vocabulary"})
    with pytest.warns(UserWarning, match="going on with sam-vit-base on cpu") as warned:
        report = map_sequence(Pictures(), tmp_path / "m.uppm", configuration(**chosen))
    assert (report.frames, report.skipped, len(asked), len(warned)) == (3, {}, 4, 1)
    assert [record.index for record in open_map(tmp_path / "m.uppm").frames] == [0, 1, 2]


def test_the_program_writes_the_map(models: Models, tmp_path: Path) -> None:
    models("mask2former")
    config = configuration(profile="mask2former", segmenter_model=tiny.NAMES["mask2former"])
    report = map_sequence(Pictures(), tmp_path / "m.uppm", config)
    assert report.frames == 3
    assert any(s.descriptor for s in open_map(tmp_path / "m.uppm").submaps)
