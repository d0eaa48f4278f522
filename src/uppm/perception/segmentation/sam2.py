"""SAM 2.1 (Ravi et al., ICLR 2025) on single images: a mask for each box, from one embedding of the image."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of
from uppm.perception.segmentation.square_input import square_input

BOXES_AT_ONCE = 64
"""Boxes that the decoder takes in one batch."""
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""ImageNet's."""


class Sam2:
    """MaskGenerator; Hiera tiny, small, base-plus or large by `masks_model`."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._network = Network(config, model_of("sam2", config.masks_model), _load, hot=lambda m: (m.vision_encoder,))

    def masks(self, frame: Frame, boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """One mask a box (N, 4): (N, H, W)."""
        if not len(boxes):
            return np.zeros((0, *frame.depth.shape), dtype=bool)
        return self._network.run(lambda loaded: _masks(loaded, frame.color, boxes))

    def close(self) -> None:
        """Release the network."""
        self._network.close()


def _load(weights: Weights) -> tuple[Any, None]:
    from transformers import Sam2Model

    return weights.pretrained(Sam2Model), None


def _masks(loaded: Loaded[None], color: npt.NDArray[np.uint8], boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    from torch.nn.functional import interpolate

    side, (height, width) = loaded.module.config.prompt_encoder_config.image_size, color.shape[:2]
    scale = np.array([side / width, side / height] * 2, dtype=np.float32)
    pixels = loaded.tensor(square_input(color, side, MEAN, STD))
    # The embedding itself, after the two finer maps that the decoder sharpens edges with.
    embeddings = loaded.module.get_image_embeddings(pixels)
    parts: list[npt.NDArray[np.bool_]] = []
    for i in range(0, len(boxes), BOXES_AT_ONCE):
        prompts = loaded.tensor(boxes[None, i : i + BOXES_AT_ONCE] * scale)
        out = loaded.module(image_embeddings=embeddings, input_boxes=prompts, multimask_output=False)
        full = interpolate(out.pred_masks[0].float(), (height, width), mode="bilinear", align_corners=False)
        parts.append((full[:, 0] > 0).cpu().numpy())
    return np.concatenate(parts)
