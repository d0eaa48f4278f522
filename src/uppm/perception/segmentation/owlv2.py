"""OWL-ViT, OWLv2 (Minderer et al., ECCV 2022, NeurIPS 2023): boxes for phrases, each compared alone with each box.

What a phrase means does not depend on the image, so that each is read once in the life of the network.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Detections, Label
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of
from uppm.perception.segmentation.prompts import Processor, detections, unique_labels

if TYPE_CHECKING:
    import torch

TEMPLATE = "a photo of a {}"
"""The models were trained on sentences such as this."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reader:
    """What stands before the network, and the prompts that it has read."""

    processor: Processor
    read: dict[str, torch.Tensor] = field(default_factory=dict[str, "torch.Tensor"])
    """Prompt -> its embedding (D,)."""


class Owlv2:
    """Detector of what it is asked for; no label's boxes depend on the others."""

    back_end, network, image = "owlv2", "Owlv2ForObjectDetection", "Owlv2ImageProcessorPil"
    score = 0.2
    """Least score of a box; these models' are lower than other detectors'."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._least = self.score if config.detector_score is None else config.detector_score
        self._network = Network(config, model_of(self.back_end, config.detector_model), self._load, hot=_hot)

    def detect(self, color: npt.NDArray[np.uint8], labels: Sequence[Label] = ()) -> Detections:
        """Boxes of an RGB image (H, W, 3), best first; a box may come once for each label that fits it."""
        prompts = unique_labels(labels)
        if not prompts:
            return detections([], color.shape)
        scores, boxes = self._network.run(lambda loaded: _ask(loaded, color, list(prompts)))
        boxes *= self._shares(color.shape[0], color.shape[1])
        named = list(prompts.values())
        found = [(named[j], float(scores[i, j]), boxes[i]) for i, j in np.argwhere(scores > self._least)]
        return detections(found, color.shape)

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _load(self, weights: Weights) -> tuple[Any, Reader]:
        import transformers

        model = weights.pretrained(getattr(transformers, self.network))
        return model, Reader(processor=Processor.load(weights, self.image))

    def _shares(self, height: int, width: int) -> npt.NDArray[np.float32]:
        """What the network's coordinates are times shares of the image: it was padded to a square, right and below."""
        return np.float32(max(height, width)) / np.array([width, height] * 2, dtype=np.float32)


class OwlVit(Owlv2):
    """OWL-ViT; its image is squeezed to a square, not padded."""

    back_end, network, image = "owlvit", "OwlViTForObjectDetection", "OwlViTImageProcessorPil"
    score = 0.1

    def _shares(self, height: int, width: int) -> npt.NDArray[np.float32]:
        return np.ones(4, dtype=np.float32)


def _ask(
    loaded: Loaded[Reader], color: npt.NDArray[np.uint8], prompts: Sequence[str]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Scores (boxes, prompts) and boxes (boxes, 4) as centre, width and height in shares of the network's square."""
    import torch

    _read(loaded, prompts)
    queries = torch.stack([loaded.helper.read[prompt] for prompt in prompts])[None]
    pixels = loaded.tensor(loaded.helper.processor.image(color, return_tensors="np")["pixel_values"])
    seen, *_ = loaded.module.image_embedder(pixels)
    places = seen.flatten(1, 2)
    logits, _ = loaded.module.class_predictor(places, queries)
    boxes = loaded.module.box_predictor(places, seen)
    return logits[0].float().sigmoid().cpu().numpy(), boxes[0].float().cpu().numpy()


def _read(loaded: Loaded[Reader], prompts: Sequence[str]) -> None:
    """Embed the prompts that are new."""
    new = [prompt for prompt in prompts if prompt not in loaded.helper.read]
    if not new:
        return
    length = loaded.module.config.text_config.max_position_embeddings
    texts = [TEMPLATE.format(prompt) for prompt in new]
    tokens = loaded.helper.processor.tokenizer(
        texts, padding="max_length", max_length=length, truncation=True, return_tensors="np"
    )
    ids, mask = (loaded.tensor(tokens[name]) for name in ("input_ids", "attention_mask"))
    vectors = _body(loaded.module).get_text_features(input_ids=ids, attention_mask=mask).pooler_output
    loaded.helper.read.update(zip(new, vectors / vectors.norm(dim=-1, keepdim=True), strict=True))


def _body(module: Any) -> Any:
    """The two encoders, which go by the model's name."""
    return getattr(module, module.base_model_prefix)


def _hot(module: Any) -> Sequence[Any]:
    return (_body(module).vision_model,)
