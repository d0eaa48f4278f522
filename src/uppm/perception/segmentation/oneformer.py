"""The profile `oneformer`: a panoptic network that is told its task (Jain et al., CVPR 2023), to compare with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame, Label, PanopticSegmentation
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of
from uppm.perception.segmentation.panoptic import to_segmentation

TASK = "the task is panoptic"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Processor:
    image: Any
    tokenizer: Any


class OneFormer:
    """Segmenter with a vocabulary of its own; it ignores the labels that it is given."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config
        self._network = Network(config, model_of("oneformer", config.segmenter_model), _load, hot=_hot)

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Nothing to learn from the sequence."""

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        """The network's segments."""
        return self._network.run(lambda loaded: self._segment(loaded, frame))

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _segment(self, loaded: Loaded[_Processor], frame: Frame) -> PanopticSegmentation:
        inputs = loaded.helper.image(frame.color, ["panoptic"], return_tensors="np")
        out = loaded.module(
            pixel_values=loaded.tensor(inputs["pixel_values"]),
            pixel_mask=loaded.tensor(inputs["pixel_mask"]),
            task_inputs=loaded.tensor(_task(loaded)),
        )
        return to_segmentation(frame, self._config, out, loaded.module.config.id2label)


def _task(loaded: Loaded[_Processor]) -> np.ndarray:
    """(1, T) tokens of the task; padding is 0, as the network was trained."""
    tokens = loaded.helper.tokenizer(
        [TASK], padding="max_length", max_length=loaded.module.config.task_seq_len, truncation=True, return_tensors="np"
    )
    return tokens["input_ids"] * tokens["attention_mask"]


def _load(weights: Weights) -> tuple[Any, _Processor]:
    from transformers import AutoTokenizer, OneFormerForUniversalSegmentation, OneFormerImageProcessorPil

    # Without its table of classes, which it would fetch from the hub and needs for training only.
    image = OneFormerImageProcessorPil.from_pretrained(weights.folder, class_info_file=None)
    tokenizer = AutoTokenizer.from_pretrained(weights.folder)
    return weights.pretrained(OneFormerForUniversalSegmentation), _Processor(image=image, tokenizer=tokenizer)


def _hot(module: Any) -> Sequence[Any]:
    return module.model.pixel_level_module, module.model.transformer_module
