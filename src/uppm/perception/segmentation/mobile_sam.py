"""MobileSAM (Zhang et al., 2023) as ONNX graphs, without torch: a mask for each box, from one look at the image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import onnxruntime

from uppm.core.config import PerceptionConfig
from uppm.core.errors import InputError
from uppm.core.types import Frame
from uppm.perception.models.onnx_session import open_session
from uppm.perception.models.store import model_folder
from uppm.perception.registry import model_of

Values = npt.NDArray[np.float32]

SIDE, LOW = 1024, 256
"""Pixels a side of the square that the encoder sees, and of the decoder's masks of it."""
MEAN = np.array([123.675, 116.28, 103.53], dtype=np.float32)
STD = np.array([58.395, 57.12, 57.375], dtype=np.float32)
CORNERS = np.array([[2, 3]], dtype=np.float32)
"""How the decoder is told that its two points are a box's upper left and lower right."""
INPUTS = {"image_embeddings", "point_coords", "point_labels", "mask_input", "has_mask_input", "orig_im_size"}
MASKS = "low_res_masks"


@dataclass(frozen=True, kw_only=True, eq=False)
class Sessions:
    encoder: onnxruntime.InferenceSession
    decoder: onnxruntime.InferenceSession


class MobileSam:
    """MaskGenerator: TinyViT as the encoder, SAM's own decoder. The decoder's graph takes one box at a time."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._name, self._threads = model_of("mobile_sam", config.masks_model), config.threads
        self._sessions: Sessions | None = None

    def masks(self, frame: Frame, boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """One mask a box (N, 4): (N, H, W)."""
        if not len(boxes):
            return np.zeros((0, *frame.depth.shape), dtype=bool)
        self._sessions = self._sessions or _load(model_folder(self._name), self._threads)
        height, width = frame.depth.shape
        inner = tuple(int(n * SIDE / max(height, width) + 0.5) for n in (height, width))
        image = np.asarray(cv2.resize(frame.color, inner[::-1], interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
        embedding = _embed(self._sessions.encoder, image)
        scale = np.array([inner[1] / width, inner[0] / height], dtype=np.float32)
        low = (_decode(self._sessions.decoder, embedding, box.reshape(1, 2, 2) * scale, inner) for box in boxes)
        return np.stack([_full(mask, inner, (height, width)) for mask in low])

    def close(self) -> None:
        """Release the graphs."""
        self._sessions = None


def _load(folder: Path, threads: int) -> Sessions:
    encoder = open_session(folder / "mobile_sam_image_encoder.onnx", threads)
    path = folder / "sam_mask_decoder_single.onnx"
    decoder = open_session(path, threads)
    known = {i.name for i in decoder.get_inputs()}, {o.name for o in decoder.get_outputs()}
    if known[0] != INPUTS or MASKS not in known[1]:
        found, advice = f"inputs {', '.join(sorted(known[0]))}", "export it with MobileSAM's own script"
        raise InputError(path, expected=f"a decoder of boxes: {', '.join(sorted(INPUTS))}", found=found, advice=advice)
    return Sessions(encoder=encoder, decoder=decoder)


def _embed(encoder: onnxruntime.InferenceSession, image: npt.NDArray[np.uint8]) -> Values:
    """Of an RGB image whose longer side is `SIDE`; graphs that pad and normalise by themselves take it as it is."""
    (given,) = encoder.get_inputs()
    values = image.astype(np.float32)
    if len(given.shape) == 4:
        square = np.zeros((SIDE, SIDE, 3), dtype=np.float32)
        square[: image.shape[0], : image.shape[1]] = (values - MEAN) / STD
        values = np.ascontiguousarray(square.transpose(2, 0, 1))[None]
    return np.asarray(encoder.run(None, {given.name: values})[0])


def _decode(
    decoder: onnxruntime.InferenceSession, embedding: Values, corners: Values, inner: tuple[int, ...]
) -> Values:
    """Logits (LOW, LOW) over the padded square, of one box's corners (1, 2, 2) in its pixels."""
    given = {
        "image_embeddings": embedding,
        "point_coords": corners.astype(np.float32),
        "point_labels": CORNERS,
        "mask_input": np.zeros((1, 1, LOW, LOW), dtype=np.float32),
        "has_mask_input": np.zeros(1, dtype=np.float32),
        "orig_im_size": np.array(inner, dtype=np.float32),
    }
    return np.asarray(decoder.run([MASKS], given)[0])[0, 0]


def _full(low: Values, inner: tuple[int, ...], size: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """A mask of the frame's size (H, W); the graph's own has the proportions of the image that it was traced with."""
    square = cv2.resize(low, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)
    return cv2.resize(square[: inner[0], : inner[1]], size[::-1], interpolation=cv2.INTER_LINEAR) > 0
