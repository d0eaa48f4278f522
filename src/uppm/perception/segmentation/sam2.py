"""SAM 2.1 (Ravi et al., ICLR 2025) on single images: a mask for each box, from one embedding of the image."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.perception.models.network import Loaded, Weights
from uppm.perception.segmentation import sam
from uppm.perception.segmentation.sam import Sam
from uppm.perception.segmentation.square_input import square_input

MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""ImageNet's."""


class Sam2(Sam):
    """MaskGenerator; Hiera large, base-plus, small or tiny by `masks_model`."""

    back_end = "sam2"

    def __init__(self, config: PerceptionConfig) -> None:
        super().__init__(config)
        self._side = config.masks_side

    def _load(self, weights: Weights) -> tuple[Any, None]:
        from transformers import Sam2Model

        return weights.pretrained(Sam2Model, self._resize), None

    def _resize(self, config: Any) -> None:
        """Let the network take a smaller square: Hiera's position encoding is interpolated to any size."""
        if self._side is None:
            return
        vision, scale = config.vision_config, self._side / config.prompt_encoder_config.image_size
        config.prompt_encoder_config.image_size = self._side
        vision.backbone_config.image_size = [self._side, self._side]
        vision.backbone_feature_sizes = [[round(n * scale) for n in size] for size in vision.backbone_feature_sizes]

    def _masks(
        self, loaded: Loaded[Any], color: npt.NDArray[np.uint8], boxes: npt.NDArray[np.float32]
    ) -> npt.NDArray[np.bool_]:
        from torch.nn.functional import interpolate

        side, (height, width) = loaded.module.config.prompt_encoder_config.image_size, color.shape[:2]
        scale = np.array([side / width, side / height] * 2, dtype=np.float32)
        pixels = loaded.tensor(square_input(color, side, MEAN, STD))
        # Two finer maps, by which the decoder sharpens edges, and the embedding.
        embeddings = loaded.module.get_image_embeddings(pixels)
        parts: list[npt.NDArray[np.bool_]] = []
        for i in range(0, len(boxes), sam.BOXES_AT_ONCE):
            prompts = loaded.tensor(boxes[None, i : i + sam.BOXES_AT_ONCE] * scale)
            out = loaded.module(image_embeddings=embeddings, input_boxes=prompts, multimask_output=False)
            full = interpolate(out.pred_masks[0].float(), (height, width), mode="bilinear", align_corners=False)
            parts.append((full[:, 0] > 0).cpu().numpy())
        return np.concatenate(parts)
