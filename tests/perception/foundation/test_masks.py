"""Mask generators on tiny random weights: what transformers' own code gives."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.perception.foundation import tiny
from uppm.core.config import PerceptionConfig
from uppm.core.protocols import MaskGenerator
from uppm.core.types import Frame
from uppm.perception.registry import create_mask_generator
from uppm.perception.segmentation import sam, sam2
from uppm.perception.segmentation.sam2 import Sam2
from uppm.perception.segmentation.square_input import square_input

Models = Callable[[str], Path]
BOXES = np.array([[0, 0, 30, 40], [20, 10, 60, 48], [5, 5, 15, 20], [30, 0, 64, 24], [1, 1, 63, 47]], dtype=np.float32)


def generator(kind: str, **settings: Any) -> MaskGenerator:
    return create_mask_generator(PerceptionConfig(masks=kind, masks_model=tiny.NAMES[kind], threads=1, **settings))


def test_sam_gives_what_transformers_gives(models: Models, picture: Frame) -> None:
    folder = models("sam")
    torch, t = tiny.torch_or_skip()
    processor = t.SamProcessor(t.SamImageProcessorPil.from_pretrained(folder))
    model = t.SamModel.from_pretrained(folder).eval()
    inputs = processor(picture.color, input_boxes=[BOXES.tolist()], return_tensors="pt")
    with torch.no_grad():
        out = model(pixel_values=inputs.pixel_values, input_boxes=inputs.input_boxes.float(), multimask_output=False)
    (theirs,) = processor.image_processor.post_process_masks(
        out.pred_masks, inputs.original_sizes, inputs.reshaped_input_sizes
    )
    ours = generator("sam").masks(picture, BOXES)
    assert ours.shape == (5, 48, 64)
    assert (ours != theirs[:, 0].numpy()).mean() < 1e-3
    assert 0.05 < ours.mean() < 0.95


@pytest.mark.parametrize("side", [None, 64])
def test_sam2_gives_what_transformers_gives(models: Models, picture: Frame, side: int | None) -> None:
    """From our input on: their processor asks for torchvision. On a smaller square, they get the sizes as well."""
    folder = models("sam2")
    torch, t = tiny.torch_or_skip()
    config = t.Sam2Config.from_pretrained(folder)
    if side is not None:
        config.prompt_encoder_config.image_size, config.vision_config.backbone_config.image_size = side, [side, side]
        config.vision_config.backbone_feature_sizes = [[side // n, side // n] for n in (4, 8, 16)]
    model = t.Sam2Model.from_pretrained(folder, config=config).eval()
    square = side or 128
    pixels = torch.from_numpy(square_input(picture.color, square, sam2.MEAN, sam2.STD))
    boxes = torch.from_numpy(BOXES * np.array([square / 64, square / 48] * 2, dtype=np.float32))[None]
    with torch.no_grad():
        out = model(pixel_values=pixels, input_boxes=boxes, multimask_output=False)
    theirs = torch.nn.functional.interpolate(out.pred_masks[0], (48, 64), mode="bilinear", align_corners=False) > 0
    ours = generator("sam2", masks_side=side).masks(picture, BOXES)
    assert (ours != theirs[:, 0].numpy()).mean() < 1e-3
    assert 0.05 < ours.mean() < 0.95


@pytest.mark.parametrize("kind", ["sam", "sam2"])
def test_the_image_is_embedded_once_and_boxes_go_in_chunks(
    models: Models, picture: Frame, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    models(kind)
    _, t = tiny.torch_or_skip()
    whole = generator(kind).masks(picture, BOXES)
    network = {"sam": t.SamModel, "sam2": t.Sam2Model}[kind]
    embed, embedded = network.get_image_embeddings, []

    def counted(*args: object, **kwargs: object) -> object:
        embedded.append(1)
        return embed(*args, **kwargs)

    monkeypatch.setattr(network, "get_image_embeddings", counted)
    monkeypatch.setattr(sam, "BOXES_AT_ONCE", 2)
    chunked = generator(kind).masks(picture, BOXES)
    assert embedded == [1]
    assert (chunked != whole).mean() < 1e-3
    assert generator(kind).masks(picture, BOXES[:0]).shape == (0, 48, 64)


@pytest.mark.heavy
def test_sam2_of_real_size_is_read_from_a_folder_as_the_hub_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, picture: Frame
) -> None:
    """The published folders are those of the video model, which holds more; weights that are missing would be named."""
    torch, t = tiny.torch_or_skip()
    torch.manual_seed(0)
    folder = tmp_path / tiny.NAMES["sam2"]
    video = t.Sam2VideoModel(t.Sam2VideoConfig())  # its defaults are Hiera tiny's
    video.save_pretrained(folder)
    monkeypatch.setenv("UPPM_MODELS", str(tmp_path))
    monkeypatch.setenv("UPPM_OFFLINE", "1")
    assert json.loads((folder / "config.json").read_text())["architectures"] == ["Sam2VideoModel"]
    published = video.state_dict()
    for side in (512, None):
        ours = Sam2(PerceptionConfig(masks="sam2", masks_model=tiny.NAMES["sam2"], masks_side=side, threads=2))
        assert ours.masks(picture, BOXES[:1]).shape == (1, 48, 64)
        own = ours._network.run(lambda loaded: loaded.module.state_dict())
        assert sum(tensor.numel() for tensor in own.values()) > 30e6
        for name, tensor in own.items():
            torch.testing.assert_close(tensor, published[name], msg=name)


def test_the_square_input_is_a_resized_normalised_image() -> None:
    """Against Pillow's bilinear filter, which averages too, but rounds twice: within one grey level of 255."""
    tiny.torch_or_skip()
    from PIL import Image

    rng = np.random.default_rng(0)
    for shape in ((30, 50, 3), (200, 90, 3), (64, 64, 3)):
        color = rng.integers(0, 256, shape).astype(np.uint8)
        ours = square_input(color, 64, sam2.MEAN, sam2.STD)
        assert ours.shape == (1, 3, 64, 64)
        resized = np.asarray(Image.fromarray(color).resize((64, 64), Image.Resampling.BILINEAR), dtype=np.float32) / 255
        theirs = (resized - np.array(sam2.MEAN)) / np.array(sam2.STD)
        grey = np.abs(ours[0].transpose(1, 2, 0) - theirs) * np.array(sam2.STD) * 255
        assert grey.max() < 1.01
        assert (grey > 0.01).mean() < 0.25


def test_the_square_input_is_that_of_sam2s_own_processor() -> None:
    _, t = tiny.torch_or_skip()
    pytest.importorskip("torchvision", reason="torchvision is not installed: SAM 2's own processor cannot run")
    color = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    theirs = t.Sam2ImageProcessor()(color, return_tensors="np")["pixel_values"]
    np.testing.assert_allclose(square_input(color, 1024, sam2.MEAN, sam2.STD), theirs, atol=1.01 / 255 / 0.224)
