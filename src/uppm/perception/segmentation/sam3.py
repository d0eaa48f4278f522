"""The profile `sam3`: masks straight from labels (SAM 3, Carion et al., 2025); detector and mask generator in one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Detections, Frame, Label, PanopticSegmentation
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of
from uppm.perception.segmentation.assembly import Mask
from uppm.perception.segmentation.prompted import assembled
from uppm.perception.segmentation.prompts import unique_labels
from uppm.perception.segmentation.square_input import square_input

SCORE = 0.5
"""Least score of an instance, as in the published demo."""
MEAN = STD = (0.5, 0.5, 0.5)
MAX_TOKENS = 32


class Sam3:
    """Segmenter of what it is asked for; each label is asked for by itself, the image is embedded once."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config
        self._score = SCORE if config.detector_score is None else config.detector_score
        self._network = Network(config, model_of("sam3", config.segmenter_model), _load, hot=_hot)

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Nothing to learn from the sequence."""

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        """The instances of each label."""
        found, masks = self._network.run(lambda loaded: self._instances(loaded, frame.color, labels))
        return assembled(frame, self._config, found, lambda keep: masks[keep])

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _instances(
        self, loaded: Loaded[Any], color: npt.NDArray[np.uint8], labels: Sequence[Label]
    ) -> tuple[Detections, npt.NDArray[np.bool_]]:
        """Boxes, and a mask (N, H, W) for each."""
        side = loaded.module.config.vision_config.image_size
        image = loaded.module.get_vision_features(loaded.tensor(square_input(color, side, MEAN, STD)))
        found: list[Instance] = []
        for prompt, label in unique_labels(labels).items():
            tokens = loaded.helper(
                prompt, padding="max_length", max_length=MAX_TOKENS, truncation=True, return_tensors="np"
            )
            ids, mask = (loaded.tensor(tokens[name]) for name in ("input_ids", "attention_mask"))
            out = loaded.module(vision_embeds=image, input_ids=ids, attention_mask=mask)
            found += self._read(out, label, color.shape)
        return _collect(found, color.shape)

    def _read(self, out: Any, label: Label, shape: tuple[int, ...]) -> Iterator[Instance]:
        """The instances of one label: those of its queries that are sure, if the label is in the image at all."""
        from torch.nn.functional import interpolate

        scores = (out.pred_logits[0].float().sigmoid() * out.presence_logits[0].float().sigmoid()).cpu().numpy()
        sure = np.flatnonzero(scores > self._score)
        if not len(sure):
            return
        probability = out.pred_masks[:, sure.tolist()].float().sigmoid()
        masks = interpolate(probability, shape[:2], mode="bilinear", align_corners=False)[0] > 0.5
        boxes = out.pred_boxes[0].float().cpu().numpy()[sure]
        yield from zip([label] * len(sure), scores[sure].tolist(), boxes, masks.cpu().numpy(), strict=True)


Instance = tuple[Label, float, npt.NDArray[np.float32], Mask]
"""Label, score, corners in shares of the image, and mask (H, W)."""


def _collect(found: Sequence[Instance], shape: tuple[int, ...]) -> tuple[Detections, npt.NDArray[np.bool_]]:
    limits = np.array([shape[1], shape[0]] * 2, dtype=np.float32)
    boxes = np.array([box for _, _, box, _ in found], dtype=np.float32).reshape(-1, 4)
    masks = np.array([mask for *_, mask in found], dtype=bool).reshape(-1, *shape[:2])
    scores = np.array([score for _, score, _, _ in found], dtype=np.float32)
    labels = tuple(label for label, *_ in found)
    return Detections(boxes=np.clip(boxes * limits, 0, limits), scores=scores, labels=labels), masks


def _load(weights: Weights) -> tuple[Any, Any]:
    from transformers import AutoTokenizer, Sam3Model

    return weights.pretrained(Sam3Model), AutoTokenizer.from_pretrained(weights.folder)


def _hot(module: Any) -> Sequence[Any]:
    return module.vision_encoder, module.detr_encoder, module.detr_decoder
