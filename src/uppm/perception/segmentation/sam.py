"""Segment Anything (Kirillov et al., ICCV 2023): a mask for each box, from one embedding of the image."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of

BOXES_AT_ONCE = 64
"""Boxes that the decoder takes in one batch; a mask of 1024x1024 takes 4 MB on its way to the frame's size."""


class Sam:
    """MaskGenerator; ViT-H, L or B by `masks_model`."""

    back_end = "sam"

    def __init__(self, config: PerceptionConfig) -> None:
        name = model_of(self.back_end, config.masks_model)
        self._network = Network(config, name, self._load, hot=lambda module: (module.vision_encoder,))

    def masks(self, frame: Frame, boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """One mask a box (N, 4): (N, H, W)."""
        if not len(boxes):
            return np.zeros((0, *frame.depth.shape), dtype=bool)
        return self._network.run(lambda loaded: self._masks(loaded, frame.color, boxes))

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _load(self, weights: Weights) -> tuple[Any, Any]:
        from transformers import SamImageProcessorPil, SamModel

        return weights.pretrained(SamModel), SamImageProcessorPil.from_pretrained(weights.folder)

    def _masks(
        self, loaded: Loaded[Any], color: npt.NDArray[np.uint8], boxes: npt.NDArray[np.float32]
    ) -> npt.NDArray[np.bool_]:
        inputs = loaded.helper(color, return_tensors="np")
        sizes = inputs["original_sizes"], inputs["reshaped_input_sizes"]
        (height, width), (inner_height, inner_width) = (size[0].tolist() for size in sizes)
        scale = np.array([inner_width / width, inner_height / height] * 2, dtype=np.float32)
        embedding = loaded.module.get_image_embeddings(loaded.tensor(inputs["pixel_values"]))
        parts: list[npt.NDArray[np.bool_]] = []
        for i in range(0, len(boxes), BOXES_AT_ONCE):
            prompts = loaded.tensor(boxes[None, i : i + BOXES_AT_ONCE] * scale)
            out = loaded.module(image_embeddings=embedding, input_boxes=prompts, multimask_output=False)
            low = out.pred_masks[0].float()
            (full,) = loaded.helper.post_process_masks([low], *(size.tolist() for size in sizes))
            parts.append(full[:, 0].cpu().numpy())
        return np.concatenate(parts)
