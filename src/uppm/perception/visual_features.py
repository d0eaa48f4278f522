"""CLIP (Radford et al., ICML 2021) and SigLIP (Zhai et al., ICCV 2023): how a part of an image looks, as a vector."""

from __future__ import annotations

from collections.abc import Sequence
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


class ClipText:
    """TextEncoder into the space of `Clip`."""

    back_end, network = Clip.back_end, Clip.parts[0]

    def __init__(self, config: PerceptionConfig) -> None:
        name = model_of(self.back_end, config.visual_feature_model)
        self._network = Network(config, name, self._load, hot=lambda module: (module.text_model,))

    def encode(self, texts: Sequence[str]) -> npt.NDArray[np.float32]:
        """(N, D) unit vectors."""
        return self._network.run(lambda loaded: self._encode(loaded, list(texts)))

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _load(self, weights: Weights) -> tuple[Any, Any]:
        import transformers

        tokenizer = transformers.AutoTokenizer.from_pretrained(weights.folder, local_files_only=True)
        return weights.pretrained(getattr(transformers, self.network)), tokenizer

    def _encode(self, loaded: Loaded[Any], texts: list[str]) -> npt.NDArray[np.float32]:
        length = loaded.module.config.text_config.max_position_embeddings
        fed = self._tokens(loaded.helper, texts, length)
        found = loaded.module.get_text_features(**{k: loaded.tensor(v) for k, v in fed.items()}).pooler_output
        vectors = found.float().cpu().numpy()
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    def _tokens(self, tokenizer: Any, texts: list[str], length: int) -> dict[str, npt.NDArray[np.int64]]:
        fed = tokenizer(texts, padding=True, truncation=True, max_length=length, return_tensors="np")
        return {name: fed[name] for name in ("input_ids", "attention_mask")}


class SiglipText(ClipText):
    """TextEncoder into the space of `Siglip`, which was trained on texts padded to full length, unmasked."""

    back_end, network = Siglip.back_end, Siglip.parts[0]

    def _tokens(self, tokenizer: Any, texts: list[str], length: int) -> dict[str, npt.NDArray[np.int64]]:
        fed = tokenizer(texts, padding="max_length", truncation=True, max_length=length, return_tensors="np")
        return {"input_ids": fed["input_ids"]}
