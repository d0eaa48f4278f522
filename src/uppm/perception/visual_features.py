"""CLIP (Radford et al., ICML 2021) and SigLIP (Zhai et al., ICCV 2023): how a part of an image looks, as a vector."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of

CROPS_AT_ONCE = 32


class Clip:
    """VisualEncoder whose vectors can be compared with those of CLIP's text encoder."""

    back_end, parts = "clip", ("CLIPModel", "CLIPImageProcessorPil")

    def __init__(self, config: PerceptionConfig) -> None:
        name = model_of(self.back_end, config.visual_feature_model)
        self._network = Network(config, name, self._load, hot=lambda module: (module.vision_model,))

    def encode(self, color: npt.NDArray[np.uint8], boxes: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """(N, D) unit vectors of the boxes (N, 4) of an RGB image (H, W, 3)."""
        crops = [color[y0:y1, x0:x1] for x0, y0, x1, y1 in boxes.tolist()]
        return self._network.run(lambda loaded: _encode(loaded, crops))

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _load(self, weights: Weights) -> tuple[Any, Any]:
        import transformers

        model, processor = (getattr(transformers, part) for part in self.parts)
        return weights.pretrained(model), processor.from_pretrained(weights.folder)


class Siglip(Clip):
    """VisualEncoder whose vectors can be compared with those of SigLIP's text encoder."""

    back_end, parts = "siglip", ("SiglipModel", "SiglipImageProcessorPil")


def _encode(loaded: Loaded[Any], crops: list[npt.NDArray[np.uint8]]) -> npt.NDArray[np.float32]:
    parts: list[npt.NDArray[np.float32]] = []
    for i in range(0, len(crops), CROPS_AT_ONCE):
        pixels = loaded.helper(crops[i : i + CROPS_AT_ONCE], return_tensors="np")["pixel_values"]
        found = loaded.module.get_image_features(pixel_values=loaded.tensor(pixels)).pooler_output
        parts.append(found.float().cpu().numpy())
    vectors = np.concatenate(parts)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
