"""Grounding DINO (Liu et al., ECCV 2024) and MM Grounding DINO: boxes for phrases (paper section 3.2.3).

A phrase is scored by its own tokens. They are its own only where it is asked for alone: within one text, fusion lets
every image feature see all phrases, and the queries are chosen by all of them, so that boxes and scores depend on
what else is asked for. `prompts: separate` gives each phrase a text of its own, a row of a batch for which the image
backbone runs once: no phrase's result depends on another's. `prompts: joint` packs the phrases, sorted, into texts of
256 tokens.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Detections, Label
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of
from uppm.perception.segmentation.prompts import Found, Processor, Row, detections, pack, phrases

if TYPE_CHECKING:
    import torch

BOX_SCORE = 0.35
"""Least score of a phrase: its best token's."""
GPU_ROWS, CPU_ROWS = 8, 1
"""Rows of one length taken at once. A CPU gains nothing by more than one, and so a phrase's numbers are the same to the
bit there whatever is asked for beside it."""
Scores = npt.NDArray[np.float32]


class GroundingDino:
    """Detector of what it is asked for."""

    back_end, network = "grounding_dino", "GroundingDinoForObjectDetection"

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config
        self._network = Network(config, model_of(self.back_end, config.detector_model), self._load, hot=_hot)

    def detect(self, color: npt.NDArray[np.uint8], labels: Sequence[Label] = ()) -> Detections:
        """Boxes of an RGB image (H, W, 3), best first; a box may come once for each label that fits it."""
        return self._network.run(lambda loaded: self._detect(loaded, color, labels))

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _load(self, weights: Weights) -> tuple[Any, Processor]:
        import transformers

        model = weights.pretrained(getattr(transformers, self.network))
        return model, Processor.load(weights, "GroundingDinoImageProcessorPil")

    def _detect(self, loaded: Loaded[Processor], color: npt.NDArray[np.uint8], labels: Sequence[Label]) -> Detections:
        rows = _rows(loaded, labels, together=self._config.prompts == "joint")
        if not rows:
            return detections([], color.shape)
        inputs = loaded.helper.image(color, return_tensors="np")
        pixels, mask = loaded.tensor(inputs["pixel_values"]), loaded.tensor(inputs["pixel_mask"])
        size, found = CPU_ROWS if loaded.device.type == "cpu" else GPU_ROWS, list[Found]()
        with _looking_once(loaded.module.model.backbone, pixels, mask):
            for batch in _batches(rows, size):
                found += self._ask(loaded, batch, pixels, mask)
        return detections(found, color.shape)

    def _ask(
        self, loaded: Loaded[Processor], rows: Sequence[Row], pixels: torch.Tensor, mask: torch.Tensor
    ) -> Iterator[Found]:
        n, ids = len(rows), loaded.tensor(np.array([row.tokens for row in rows]))
        out = loaded.module(pixel_values=pixels.expand(n, -1, -1, -1), pixel_mask=mask.expand(n, -1, -1), input_ids=ids)
        scores, boxes = (values.float().cpu().numpy() for values in (out.logits.float().sigmoid(), out.pred_boxes))
        for row, score, box in zip(rows, scores, boxes, strict=True):
            yield from self._read(row, score, box)

    def _read(self, row: Row, scores: Scores, boxes: npt.NDArray[np.float32]) -> Iterator[Found]:
        """What one text found, from token scores (queries, tokens) and boxes (queries, 4).

        A box that only `red` of `red chair` speaks for is none: the head noun has to be over the text threshold.
        """
        least = BOX_SCORE if self._config.detector_score is None else self._config.detector_score
        for phrase, start in zip(row.phrases, row.starts, strict=True):
            own = scores[:, start : start + len(phrase.tokens)]
            best, head = own.max(axis=1), own[:, phrase.head].max(axis=1)
            for i in np.flatnonzero((best > least) & (head > self._config.text_score)):
                yield phrase.label, float(best[i]), boxes[i]


class MMGroundingDino(GroundingDino):
    """The same network trained by MMDetection on more data (Zhao et al., 2024); its class logits have a bias."""

    back_end, network = "mm_grounding_dino", "MMGroundingDinoForObjectDetection"


def _rows(loaded: Loaded[Processor], labels: Sequence[Label], *, together: bool) -> list[Row]:
    tokenizer = loaded.helper.tokenizer
    some = phrases(labels, lambda word: tokenizer.encode(word, add_special_tokens=False))
    stop = tokenizer.convert_tokens_to_ids(".")
    ends = tokenizer.cls_token_id, stop, tokenizer.sep_token_id
    return pack(some, *ends, max_tokens=loaded.module.config.max_text_len, together=together)


def _batches(rows: Sequence[Row], size: int) -> Iterator[list[Row]]:
    """Rows of one length together: no padding, which would have to be masked."""
    for _, same in groupby(sorted(rows, key=lambda row: len(row.tokens)), key=lambda row: len(row.tokens)):
        alike = list(same)
        for i in range(0, len(alike), size):
            yield alike[i : i + size]


@contextmanager
def _looking_once(backbone: Any, pixels: torch.Tensor, mask: torch.Tensor) -> Iterator[None]:
    """Inside, every row of every batch gets the features of this one image, computed here."""
    maps, positions = backbone(pixels, mask)

    def shared(pixel_values: torch.Tensor, pixel_mask: torch.Tensor) -> Any:
        n = len(pixel_values)
        grown = [(features.expand(n, -1, -1, -1), valid.expand(n, -1, -1)) for features, valid in maps]
        return grown, [position.expand(n, -1, -1, -1) for position in positions]

    backbone.forward = shared
    try:
        yield
    finally:
        del backbone.forward


def _hot(module: Any) -> Sequence[Any]:
    return module.model.backbone.conv_encoder, module.model.encoder, module.model.decoder
