"""The profile `oneformer`: a panoptic network that is told its task (Jain et al., CVPR 2023), to compare with."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.perception.models.network import Loaded, Weights
from uppm.perception.segmentation.mask2former import Mask2Former
from uppm.perception.segmentation.prompts import Processor

TASK = "the task is panoptic"


class OneFormer(Mask2Former):
    """Segmenter with a vocabulary of its own, as Mask2Former, from which it differs by its input."""

    back_end = "oneformer"

    def _load(self, weights: Weights) -> tuple[Any, Any]:
        from transformers import OneFormerForUniversalSegmentation

        # Without its table of classes, which it would fetch from the hub and needs for training only.
        processor = Processor.load(weights, "OneFormerImageProcessorPil", class_info_file=None)
        return weights.pretrained(OneFormerForUniversalSegmentation), processor

    def _inputs(self, loaded: Loaded[Any], color: npt.NDArray[np.uint8]) -> dict[str, npt.NDArray[Any]]:
        """What the network takes, by name; padding of the task's text is 0, as it was trained."""
        length = loaded.module.config.task_seq_len
        tokens = loaded.helper.tokenizer(
            [TASK], padding="max_length", max_length=length, truncation=True, return_tensors="np"
        )
        image = loaded.helper.image(color, ["panoptic"], return_tensors="np")
        return {
            "pixel_values": image["pixel_values"],
            "pixel_mask": image["pixel_mask"],
            "task_inputs": tokens["input_ids"] * tokens["attention_mask"],
        }
