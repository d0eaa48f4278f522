"""CLIP and SigLIP on tiny random weights: what transformers' own code gives."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.perception.foundation import tiny
from uppm.core.config import PerceptionConfig
from uppm.core.errors import ConfigError
from uppm.core.types import Frame
from uppm.perception import visual_features
from uppm.perception.registry import create_look_encoder, create_visual_encoder

BOXES = np.array([[0, 0, 64, 48], [10, 5, 30, 40], [40, 40, 43, 42]])


@pytest.mark.parametrize(("kind", "dimensions"), [("clip", 16), ("siglip", 32)])
def test_vectors_are_what_transformers_gives(
    models: Callable[[str], Path], picture: Frame, kind: str, dimensions: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = models(kind)
    torch, t = tiny.torch_or_skip()
    network, processor = {
        "clip": (t.CLIPModel, t.CLIPImageProcessorPil), "siglip": (t.SiglipModel, t.SiglipImageProcessorPil)
    }[kind]  # fmt: skip
    crops = [picture.color[y0:y1, x0:x1] for x0, y0, x1, y1 in BOXES.tolist()]
    inputs = processor.from_pretrained(folder)(crops, return_tensors="pt")
    with torch.no_grad():
        theirs = network.from_pretrained(folder).eval().get_image_features(**inputs).pooler_output.numpy()
    monkeypatch.setattr(visual_features, "CROPS_AT_ONCE", 2)
    config = PerceptionConfig.model_validate(
        {"visual_feature": kind, "visual_feature_model": tiny.NAMES[kind], "threads": 1}
    )
    ours = create_visual_encoder(config).encode(picture.color, BOXES)
    assert ours.shape == (3, dimensions)
    np.testing.assert_allclose(ours, theirs / np.linalg.norm(theirs, axis=1, keepdims=True), atol=1e-5)
    assert np.abs(ours[0] - ours[1]).max() > 1e-3


@pytest.mark.parametrize("kind", ["clip", "siglip"])
def test_texts_are_what_transformers_gives(models: Callable[[str], Path], kind: str) -> None:
    folder = models(kind)
    torch, t = tiny.torch_or_skip()
    if kind == "siglip":  # Its own tokenizer is a SentencePiece model, of which there is no tiny one.
        tiny.letters(folder)
    texts = ["a photo of a cup", "a photo of a red chair"]
    tokenizer = t.AutoTokenizer.from_pretrained(folder)
    padding: dict[str, object] = {"padding": "max_length", "max_length": 64} if kind == "siglip" else {"padding": True}
    inputs = tokenizer(texts, return_tensors="pt", **padding)
    if kind == "siglip":
        inputs.pop("attention_mask", None)
    network = {"clip": t.CLIPModel, "siglip": t.SiglipModel}[kind].from_pretrained(folder).eval()
    with torch.no_grad():
        theirs = network.get_text_features(**inputs).pooler_output.numpy()
    config = PerceptionConfig.model_validate(
        {"visual_feature": kind, "visual_feature_model": tiny.NAMES[kind], "threads": 1}
    )
    encoder = create_look_encoder(config)
    np.testing.assert_allclose(encoder.encode(texts), theirs / np.linalg.norm(theirs, axis=1, keepdims=True), atol=1e-5)


def test_a_feature_without_a_text_side_is_named() -> None:
    with pytest.raises(ConfigError, match=r"perception.visual_feature: expected one of clip, siglip, found 'none'"):
        create_look_encoder(PerceptionConfig())
