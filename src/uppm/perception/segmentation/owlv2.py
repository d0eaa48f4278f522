"""OWLv2 (Minderer et al., NeurIPS 2023): boxes for phrases; each phrase is compared with each box by itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Detections, Label
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of
from uppm.perception.segmentation.prompts import Processor, detections, unique_labels

SCORE = 0.2
"""Least score of a box; OWLv2's are lower than other detectors'."""
TEMPLATE = "a photo of a {}"
"""The model was trained on sentences such as this."""


class Owlv2:
    """Detector of what it is asked for; no label's boxes depend on the others."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._least = SCORE if config.detector_score is None else config.detector_score
        self._network = Network(config, model_of("owlv2", config.detector_model), _load)

    def detect(self, color: npt.NDArray[np.uint8], labels: Sequence[Label] = ()) -> Detections:
        """Boxes of an RGB image (H, W, 3), best first; a box may come once for each label that fits it."""
        prompts = unique_labels(labels)
        if not prompts:
            return detections([], color.shape)
        scores, boxes = self._network.run(lambda loaded: _ask(loaded, color, list(prompts)))
        # The image was padded to a square, right and below.
        boxes *= np.float32(max(color.shape[:2])) / np.array([color.shape[1], color.shape[0]] * 2, dtype=np.float32)
        named = list(prompts.values())
        found = [(named[j], float(scores[i, j]), boxes[i]) for i, j in np.argwhere(scores > self._least)]
        return detections(found, color.shape)

    def close(self) -> None:
        """Release the network."""
        self._network.close()


def _load(weights: Weights) -> tuple[Any, Processor]:
    from transformers import Owlv2ForObjectDetection

    return weights.pretrained(Owlv2ForObjectDetection), Processor.load(weights, "Owlv2ImageProcessorPil")


def _ask(
    loaded: Loaded[Processor], color: npt.NDArray[np.uint8], prompts: Sequence[str]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Scores (boxes, prompts) and boxes (boxes, 4) as centre, width and height in shares of the padded square."""
    pixels = loaded.tensor(loaded.helper.image(color, return_tensors="np")["pixel_values"])
    texts = [TEMPLATE.format(prompt) for prompt in prompts]
    length = loaded.module.config.text_config.max_position_embeddings
    tokens = loaded.helper.tokenizer(
        texts, padding="max_length", max_length=length, truncation=True, return_tensors="np"
    )
    ids, mask = (loaded.tensor(tokens[name]) for name in ("input_ids", "attention_mask"))
    out = loaded.module(input_ids=ids, attention_mask=mask, pixel_values=pixels)
    return out.logits[0].float().sigmoid().cpu().numpy(), out.pred_boxes[0].float().cpu().numpy()
