"""NanoDet on COCO-80: the small closed-set detector that ships with the package."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.categories import unified_categories
from uppm.core.config import PerceptionConfig
from uppm.core.types import Detections, Label, Provenance
from uppm.perception.models.onnx_session import open_session
from uppm.perception.segmentation.suppression import classic

MIN_SCORE = 0.4
SIDE = 416
"""Input side, pixels; the image is resized without letterbox."""
STRIDES = (8, 16, 32)
BINS = np.arange(11, dtype=np.float32)
"""Each side of a box is a distribution over these distances, in strides."""
MEAN_BGR = np.array([103.53, 116.28, 123.675], dtype=np.float32)
STD_BGR = np.array([57.375, 57.12, 58.395], dtype=np.float32)


class NanoDet:
    """Detector over COCO's 80 things; it ignores the labels that it is given."""

    def __init__(self, config: PerceptionConfig) -> None:
        model = resources.files("uppm.data").joinpath("nanodet_coco80_fp16.onnx").read_bytes()
        self._session = open_session(model, config.threads)
        self._min_score = MIN_SCORE if config.detector_score is None else config.detector_score
        self._nms_iou = config.detector_nms_iou
        names = [category.name for category in unified_categories() if category.is_thing]
        self._labels = tuple(Label(text=name, provenance=Provenance.DETECTOR) for name in names)

    def detect(self, color: npt.NDArray[np.uint8], labels: Sequence[Label] = ()) -> Detections:
        """Boxes of an RGB image (H, W, 3), best first."""
        outputs = [np.asarray(output)[0] for output in self._session.run(None, {"x": preprocess(color)})]
        boxes, scores, classes = decode(outputs[:3], outputs[3:], self._min_score)
        height, width = color.shape[:2]
        boxes *= np.array([width, height, width, height], dtype=np.float32) / SIDE
        np.clip(boxes, 0, (width, height, width, height), out=boxes)
        keep = classic(boxes, scores, classes, self._nms_iou)
        return Detections(boxes=boxes[keep], scores=scores[keep], labels=tuple(self._labels[c] for c in classes[keep]))


def preprocess(color: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Network input (1, 3, 416, 416), BGR, normalised."""
    small = cv2.resize(color, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)
    out = np.ascontiguousarray(small.transpose(2, 0, 1)[::-1], dtype=np.float32)
    out -= MEAN_BGR[:, None, None]
    out /= STD_BGR[:, None, None]
    return out[None]


def decode(
    scores: Sequence[npt.NDArray[np.float32]], distributions: Sequence[npt.NDArray[np.float32]], min_score: float
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.int64]]:
    """Boxes (N, 4) in network pixels, scores (N,) and classes (N,) of all levels over the score cut.

    `scores` holds (n, 80) a level, `distributions` (n, 44): logits over 11 bins for left, top, right, bottom.
    """
    found: list[tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.int64]]] = []
    for level, bins, stride in zip(scores, distributions, STRIDES, strict=True):
        cell, kind = np.nonzero(level > min_score)
        logits = bins[cell].reshape(-1, 4, len(BINS))
        weights = np.exp(logits - logits.max(axis=-1, keepdims=True))
        sides = (weights @ BINS) / weights.sum(axis=-1) * stride
        row, column = np.divmod(cell, SIDE // stride)
        center = (np.stack([column, row], axis=1) + 0.5) * stride
        boxes = np.concatenate([center - sides[:, :2], center + sides[:, 2:]], axis=1)
        found.append((boxes.astype(np.float32), level[cell, kind], kind.astype(np.int64)))
    boxes, best, classes = zip(*found, strict=True)
    return np.concatenate(boxes), np.concatenate(best), np.concatenate(classes)
