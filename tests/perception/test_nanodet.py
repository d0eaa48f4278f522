"""The shipped detector: its file, its arithmetic and what it finds."""

from __future__ import annotations

import hashlib
from importlib import resources

import numpy as np
import onnx
import onnxruntime
import pytest

from tests.conftest import shared_data
from uppm import open_sequence
from uppm.core.config import PerceptionConfig
from uppm.perception.registry import create_detector
from uppm.perception.segmentation.nanodet import MEAN_BGR, SIDE, STD_BGR, STRIDES, decode, preprocess

MODEL = resources.files("uppm.data").joinpath("nanodet_coco80_fp16.onnx")


def test_weights_are_half_precision_and_licensed() -> None:
    model = onnx.load_from_string(MODEL.read_bytes())
    stored = {i.data_type for i in model.graph.initializer if len(i.dims) == 4}
    assert stored == {onnx.TensorProto.FLOAT16}
    assert len(MODEL.read_bytes()) < 7_700_000
    assert resources.files("uppm.data").joinpath("nanodet_LICENSE.txt").read_text().startswith("MIT License")


def test_outputs_equal_the_reference_model() -> None:
    reference = onnxruntime.InferenceSession(str(shared_data("models/nanodet_coco80.onnx")))
    shipped = onnxruntime.InferenceSession(MODEL.read_bytes())
    x = np.random.default_rng(0).normal(size=(1, 3, SIDE, SIDE)).astype(np.float32)
    by_shape = {o.shape: o for o in map(np.asarray, reference.run(None, {"x": x}))}
    for output in map(np.asarray, shipped.run(None, {"x": x})):
        np.testing.assert_allclose(output, by_shape[output.shape], atol=1e-4)


def test_preprocessing_is_bgr_and_normalised() -> None:
    color = np.full((30, 50, 3), (255, 0, 10), dtype=np.uint8)
    x = preprocess(color)
    assert x.shape == (1, 3, SIDE, SIDE)
    expected = (np.array([10, 0, 255]) - MEAN_BGR) / STD_BGR
    np.testing.assert_allclose(x[0, :, 100, 100], expected, rtol=1e-5)


def test_decoding_agrees_with_a_loop() -> None:
    rng = np.random.default_rng(3)
    cells = [(SIDE // stride) ** 2 for stride in STRIDES]
    scores = [rng.random((n, 80)).astype(np.float32) ** 40 for n in cells]
    bins = [rng.normal(size=(n, 44)).astype(np.float32) for n in cells]
    boxes, best, classes = decode(scores, bins, 0.6)
    expected = []
    for level, logits, stride in zip(scores, bins, STRIDES, strict=True):
        for cell, kind in np.argwhere(level > 0.6):
            weights = np.exp(logits[cell].reshape(4, 11))
            left, top, right, bottom = (weights / weights.sum(axis=1, keepdims=True)) @ np.arange(11) * stride
            x, y = (cell % (SIDE // stride) + 0.5) * stride, (cell // (SIDE // stride) + 0.5) * stride
            expected.append((x - left, y - top, x + right, y + bottom, level[cell, kind], kind))
    np.testing.assert_allclose(np.column_stack([boxes, best, classes]), expected, rtol=1e-4, atol=1e-3)
    assert len(expected) > 100


@pytest.mark.parametrize("shape", [(480, 640, 3), (1, 1, 3), (7, 900, 3)])
def test_an_empty_image_of_any_size_has_no_detections(shape: tuple[int, int, int]) -> None:
    found = create_detector(PerceptionConfig()).detect(np.zeros(shape, dtype=np.uint8), ())
    assert found.boxes.shape == (0, 4)


def test_it_finds_the_flats_television_and_chair() -> None:
    frame = open_sequence(shared_data("data/flat/run1")).frame(60)
    detector = create_detector(PerceptionConfig())
    found = detector.detect(frame.color, ())
    assert {"tv", "chair"} <= {label.text for label in found.labels}
    assert (found.boxes[:, :2] < found.boxes[:, 2:]).all()
    assert found.boxes.min() >= 0
    assert found.boxes[:, 2].max() <= 640
    again = detector.detect(frame.color, ())
    np.testing.assert_array_equal(found.boxes, again.boxes)


def test_the_package_ships_the_file_that_the_script_makes() -> None:
    digest = hashlib.sha256(MODEL.read_bytes()).hexdigest()
    assert digest == "4dc006b626bd2a00ade21115518b05cb63fc354d96db765677b03f9b03961ace"
