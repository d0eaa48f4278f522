"""MobileSAM's back end on graphs whose masks are known: the decoder's is positive inside the box that it is given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest

from tests.perception.foundation import tiny
from uppm.core.config import PerceptionConfig
from uppm.core.errors import InputError
from uppm.core.types import Frame, Intrinsics
from uppm.perception.fakes import fake_frame
from uppm.perception.registry import create_mask_generator

CONFIG = PerceptionConfig(masks="mobile_sam", threads=1)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("UPPM_MODELS", str(tmp_path))
    monkeypatch.setenv("UPPM_OFFLINE", "1")
    return tiny.made("mobile_sam", tmp_path)


def picture(height: int, width: int) -> Frame:
    k = Intrinsics(fx=64, fy=64, cx=width / 2, cy=height / 2, width=width, height=height)
    color, depth = np.zeros((height, width, 3), dtype=np.uint8), np.ones((height, width), dtype=np.float32)
    return replace(fake_frame(), color=color, depth=depth, intrinsics=k)


@pytest.mark.parametrize("normalised", [False, True], ids=["raw image", "normalised square"])
@pytest.mark.parametrize(("height", "width"), [(48, 64), (64, 36)])
def test_boxes_come_back_where_they_were(
    folder: Path, monkeypatch: pytest.MonkeyPatch, height: int, width: int, normalised: bool
) -> None:
    """Through the scaling to the square, its padding, and back; images broader and higher than wide."""
    tiny.write_encoder(folder / "mobile_sam_image_encoder.onnx", normalised=normalised)
    boxes = np.array([[4, 6, 20, 30], [10, 12, 30, 44]], dtype=np.float32)
    frame = picture(height, width)
    masks = create_mask_generator(CONFIG).masks(frame, boxes)
    assert masks.shape == (2, height, width)
    rows, columns = np.mgrid[:height, :width] + 0.5
    for mask, (x0, y0, x1, y1) in zip(masks, boxes.tolist(), strict=True):
        # What lies within half a pixel of the outline may fall on either side.
        inside = np.minimum.reduce([columns - x0, x1 - columns, rows - y0, y1 - rows])
        assert mask[inside > 0.6].all()
        assert not mask[inside < -0.6].any()


def test_the_image_decides_too(folder: Path) -> None:
    """The tiny decoder turns its mask inside out where the image is bright."""
    boxes = np.array([[4, 6, 20, 30]], dtype=np.float32)
    dark = picture(48, 64)
    bright = replace(dark, color=np.full_like(dark.color, 255))
    generator = create_mask_generator(CONFIG)
    np.testing.assert_array_equal(generator.masks(dark, boxes), ~generator.masks(bright, boxes))
    assert generator.masks(dark, boxes[:0]).shape == (0, 48, 64)


def test_another_decoder_is_refused(folder: Path) -> None:
    path = folder / "sam_mask_decoder_single.onnx"
    (folder / "uppm-lock.json").unlink(missing_ok=True)
    onnx.save(onnx.load(folder / "mobile_sam_image_encoder.onnx"), path)
    with pytest.raises(InputError, match=r"expected a decoder of boxes: .*found inputs input_image"):
        create_mask_generator(CONFIG).masks(fake_frame(), np.array([[0, 0, 9, 9]], dtype=np.float32))
