"""The profile `mask2former`: closed-set panoptic segmentation (Cheng et al., CVPR 2022), to compare with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame, Label, PanopticSegmentation
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of
from uppm.perception.segmentation.panoptic import to_segmentation


class Mask2Former:
    """Segmenter with a vocabulary of its own; it ignores the labels that it is given."""

    back_end = "mask2former"

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config
        self._network = Network(config, model_of(self.back_end, config.segmenter_model), self._load, hot=_hot)

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Nothing to learn from the sequence."""

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        """The network's segments."""
        return self._network.run(lambda loaded: self._segment(loaded, frame))

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _segment(self, loaded: Loaded[Any], frame: Frame) -> PanopticSegmentation:
        inputs = {name: loaded.tensor(array) for name, array in self._inputs(loaded, frame.color).items()}
        return to_segmentation(frame, self._config, loaded.module(**inputs), loaded.module.config.id2label)

    def _load(self, weights: Weights) -> tuple[Any, Any]:
        from transformers import Mask2FormerForUniversalSegmentation, Mask2FormerImageProcessorPil

        processor = Mask2FormerImageProcessorPil.from_pretrained(weights.folder)
        return weights.pretrained(Mask2FormerForUniversalSegmentation), processor

    def _inputs(self, loaded: Loaded[Any], color: npt.NDArray[np.uint8]) -> dict[str, npt.NDArray[Any]]:
        """What the network takes, by name."""
        return dict(loaded.helper(color, return_tensors="np"))


def _hot(module: Any) -> Sequence[Any]:
    return module.model.pixel_level_module, module.model.transformer_module
