"""Florence-2 (Xiao et al., CVPR 2024) by transformers: a caption, and the labels of its dense regions as tags."""

from __future__ import annotations

from typing import Any

from uppm.core.config import PerceptionConfig
from uppm.core.language import Caption
from uppm.core.types import Frame
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of

CAPTION, REGIONS = "<CAPTION>", "<DENSE_REGION_CAPTION>"
"""Tasks, as the network's prompts name them."""
MAX_TOKENS = 256
"""Of an answer; some forty regions."""


class Florence2:
    """Captioner and tagger; base or large by `captioner_model`."""

    def __init__(self, config: PerceptionConfig) -> None:
        name = model_of("florence2", config.captioner_model)
        self._network = Network(config, str(name), load, hot=lambda module: (module.model.vision_tower,))
        self._beams, self._tags = config.caption_beams, config.use_tags
        self._write = config.use_captions or not config.use_tags

    def caption(self, frame: Frame) -> Caption:
        """One sentence, and what the regions of the colour image are called; what is not used is not asked for."""
        text = self._ask(frame, CAPTION) if self._write else ""
        if not self._tags:
            return Caption(text=text)
        regions = self._ask(frame, REGIONS)["labels"]
        return Caption(text=text, tags=tuple(dict.fromkeys(label for label in regions if label)))

    def _ask(self, frame: Frame, task: str) -> Any:
        return self._network.run(lambda loaded: answer(loaded, frame, task, self._beams))[task]

    def close(self) -> None:
        """Release the network."""
        self._network.close()


def load(weights: Weights) -> tuple[Any, Any]:
    """The network and its processor from a model's folder."""
    from transformers import Florence2ForConditionalGeneration, Florence2Processor

    processor = Florence2Processor.from_pretrained(weights.folder, local_files_only=True, backend="pil")
    return weights.pretrained(Florence2ForConditionalGeneration), processor


def answer(loaded: Loaded[Any], frame: Frame, task: str, beams: int) -> dict[str, Any]:
    """What the network says to a task, read as its authors' code does."""
    height, width = frame.depth.shape
    given = loaded.helper(text=task, images=frame.color, return_tensors="np")
    tensors = {name: loaded.tensor(array) for name, array in given.items()}
    ids = loaded.module.generate(**tensors, max_new_tokens=MAX_TOKENS, num_beams=beams, do_sample=False)
    said = loaded.helper.batch_decode(ids, skip_special_tokens=False)[0]
    return loaded.helper.post_process_generation(said, task=task, image_size=(width, height))
