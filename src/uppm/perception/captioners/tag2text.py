"""Tag2Text (Huang et al., ICLR 2024; arXiv 2303.05657): tags and a caption from one forward pass (paper section 3.2.1).

A Swin reads the image. A tagging head, queries by tag and cross-attention as in Query2Label, says which tags apply. An
encoder lets the tags' words see the image, and a decoder writes the caption from what the encoder made of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from uppm.core.config import PerceptionConfig
from uppm.core.language import Caption
from uppm.core.types import Frame
from uppm.perception.captioners.beam import BeamOptions, beam_search
from uppm.perception.captioners.bert import BERT_BASE, TAGGING_HEAD, Bert, BertSize, Cache, WordHead
from uppm.perception.captioners.checkpoint import read_architecture, read_checkpoint, read_tags, square_image
from uppm.perception.captioners.swin import SWIN_B, Swin, SwinSize
from uppm.perception.captioners.wordpieces import WordPieces
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.models.store import model_folder
from uppm.perception.models.table import BERT
from uppm.perception.registry import model_of

PROMPT = "a picture of "
THRESHOLD = 0.68
RAISED = {"person": 0.7, "man": 0.7, "woman": 0.7}
"""Thresholds of tags that apply more often than they should."""
SILENCED = frozenset({"quarter", "back", "two", "three", "four", "five", "one"})
"""Tags that disturb the caption: counts and the like."""


@dataclass(frozen=True, kw_only=True)
class Tag2TextSize:
    """The architecture; the defaults are the published checkpoint's (Swin-B, 384 pixels, 14 million images)."""

    swin: SwinSize = SWIN_B
    text: BertSize = BERT_BASE
    tagging: BertSize = TAGGING_HEAD
    tags: int = 3429


class Tag2TextNetwork(nn.Module):
    """The network, with the names of the published checkpoint."""

    def __init__(self, size: Tag2TextSize) -> None:
        super().__init__()
        channels = size.swin.channels
        self.visual_encoder = Swin(size.swin)
        self.tag_encoder = Bert(size.text.attending(channels))
        self.text_decoder = TextDecoder(size.text)
        self.tagging_head = Bert(size.tagging.attending(channels), words=False)
        self.label_embed = nn.Embedding(size.tags, size.tagging.width)
        self.fc = TagHead(size.tags, size.tagging.width)

    def tag_logits(self, seen: Tensor) -> Tensor:
        """What the Swin saw (B, S, C) -> (B, tags)."""
        queries = self.label_embed.weight.expand(len(seen), -1, -1)
        return self.fc(self.tagging_head.cross(queries, seen))

    def write(self, source: Tensor, prompt: list[int], options: BeamOptions) -> list[int]:
        """Token ids of the caption, prompt included, from what the tag encoder made of tags and image (1, T, C)."""
        decoder = self.text_decoder
        sources = decoder.bert.sources(source)

        def step(ids: Tensor, past: Cache | None) -> tuple[Tensor, Cache]:
            states, cache = decoder.bert.decode(ids, sources, past or [])
            return decoder.cls(states[:, -1]), cache

        def reorder(cache: Cache, rows: Tensor) -> Cache:
            return [(k[rows], v[rows]) for k, v in cache]

        return beam_search(prompt, step, reorder, options, source.device)


class TextDecoder(nn.Module):
    def __init__(self, size: BertSize) -> None:
        super().__init__()
        self.bert = Bert(size.attending(size.width))
        self.cls = WordHead(size)


class TagHead(nn.Module):
    """One linear classifier a tag."""

    def __init__(self, tags: int, width: int) -> None:
        super().__init__()
        self.W = nn.Parameter(torch.zeros(1, tags, width))
        self.b = nn.Parameter(torch.zeros(1, tags))

    def forward(self, states: Tensor) -> Tensor:
        return (self.W * states).sum(dim=-1) + self.b


@dataclass(frozen=True, kw_only=True)
class Vocabulary:
    """What the network's outputs mean."""

    tags: tuple[str, ...]
    words: WordPieces
    image: int
    """Side of the input, pixels."""

    def applying(self, logits: np.ndarray) -> tuple[str, ...]:
        """Tags whose probability is above their threshold, in the list's order."""
        probable = 1 / (1 + np.exp(-logits.astype(np.float64)))
        return tuple(
            tag
            for tag, p in zip(self.tags, probable, strict=True)
            if p > RAISED.get(tag, THRESHOLD) and tag not in SILENCED
        )


class Tag2Text:
    """Captioner and tagger of the paper; a `Captioner`."""

    def __init__(self, config: PerceptionConfig) -> None:
        name = model_of("tag2text", config.captioner_model)
        self._network = Network(config, str(name), load, hot=lambda module: (module.visual_encoder,))
        self._beams = config.caption_beams
        self._write = config.use_captions or not config.use_tags

    def caption(self, frame: Frame) -> Caption:
        """Caption and tags of the frame's colour image; no caption where captions are not used."""
        return self._network.run(lambda loaded: self._caption(frame, loaded))

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _caption(self, frame: Frame, loaded: Loaded[Vocabulary]) -> Caption:
        network, vocabulary = loaded.module, loaded.helper
        seen = network.visual_encoder(loaded.tensor(square_image(frame.color, vocabulary.image)))
        tags = vocabulary.applying(network.tag_logits(seen)[0].float().cpu().numpy())
        if not self._write:
            return Caption(tags=tags)
        ids, mask = vocabulary.words.tags(tags)
        source = network.tag_encoder.encode(loaded.tensor(ids[None]), loaded.tensor(mask[None]), seen)
        options = BeamOptions(end=vocabulary.words.end, beams=self._beams)
        written = network.write(source, vocabulary.words.prompt(PROMPT), options)
        return Caption(text=vocabulary.words.text(written)[len(PROMPT) :], tags=tags)


def load(weights: Weights) -> tuple[Any, Vocabulary]:
    """The network and its vocabulary from a model's folder."""
    size = read_architecture(weights.folder, Tag2TextSize())
    words = WordPieces(model_folder(BERT) / "vocab.txt", size.text.vocabulary)
    network = read_checkpoint(weights, lambda: Tag2TextNetwork(size), renamed={"vision_multi": "tagging_head"})
    tags = read_tags(Path(weights.folder), "tags_tag2text.txt", size.tags)
    return network, Vocabulary(tags=tags, words=words, image=size.swin.image)
