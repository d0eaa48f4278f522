"""RAM++ (Huang et al., arXiv 2310.15200): tags of an image, from 4,585 or from a list of one's own; no caption.

Each tag is known by several descriptions, embedded by CLIP. The image weighs them, and a tagging head as Tag2Text's
says which tags apply. Other tags need other embeddings, and no training.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn
from torch.nn import functional

from uppm.core.config import PerceptionConfig
from uppm.core.language import Caption
from uppm.core.types import Frame
from uppm.perception.captioners.bert import TAGGING_HEAD, Bert, BertSize
from uppm.perception.captioners.checkpoint import (
    read_architecture,
    read_checkpoint,
    read_tags,
    read_thresholds,
    square_image,
)
from uppm.perception.captioners.open_tags import OPEN_THRESHOLD, embed_descriptions
from uppm.perception.captioners.swin import SWIN_L, Swin, SwinSize
from uppm.perception.captioners.tag_list import read_descriptions
from uppm.perception.models.network import Loaded, Network, Weights
from uppm.perception.registry import model_of

CLIP_WIDTH = 512
"""Channels of CLIP ViT-B/16's embeddings."""


@dataclass(frozen=True, kw_only=True)
class RamPlusSize:
    """The architecture; the defaults are the published checkpoint's (Swin-L, 384 pixels, 14 million images)."""

    swin: SwinSize = SWIN_L
    tagging: BertSize = TAGGING_HEAD
    tags: int = 4585
    descriptions: int = 51
    """Of each tag."""
    clip: int = CLIP_WIDTH


class RamPlusNetwork(nn.Module):
    """The network, with the names of the published checkpoint."""

    def __init__(self, size: RamPlusSize) -> None:
        super().__init__()
        self._descriptions = size.descriptions
        self.visual_encoder = Swin(size.swin)
        self.image_proj = nn.Linear(size.swin.channels, size.clip)
        self.label_embed = nn.Parameter(torch.zeros(size.tags * size.descriptions, size.clip), requires_grad=False)
        self.reweight_scale = nn.Parameter(torch.tensor(float(np.log(1 / 0.07))))
        same = size.clip == size.tagging.width
        self.wordvec_proj = nn.Identity() if same else nn.Linear(size.clip, size.tagging.width)
        self.tagging_head = Bert(size.tagging.attending(size.clip), words=False)
        self.fc = nn.Linear(size.tagging.width, 1)

    def forward(self, image: Tensor, described: Tensor | None = None) -> Tensor:
        """One image (1, 3, S, S), and descriptions (K, D, C) of other tags than the network's own -> logits (K,)."""
        seen = self.image_proj(self.visual_encoder(image))
        if described is None:
            described = self.label_embed.unflatten(0, (-1, self._descriptions))
        mean = functional.normalize(seen[0, 0], dim=0)
        weights = (self.reweight_scale.exp() * (described @ mean)).softmax(dim=1)
        tags = torch.einsum("kd,kdc->kc", weights, described)
        queries = functional.relu(self.wordvec_proj(tags))
        return self.fc(self.tagging_head.cross(queries[None], seen))[0, :, 0]


@dataclass(frozen=True, kw_only=True)
class TagList:
    """What the network's outputs mean."""

    tags: tuple[str, ...]
    thresholds: npt.NDArray[np.float64]
    """Least probability of each."""
    described: npt.NDArray[np.float32] | None
    """(K, D, C) embeddings of tags that are not the network's own."""
    image: int
    """Side of the input, pixels."""


class RamPlus:
    """Tagger; a `Captioner` whose caption is empty."""

    def __init__(self, config: PerceptionConfig) -> None:
        name = model_of("ram_plus", config.captioner_model)
        self._config = config
        self._network = Network(config, str(name), self._load, hot=lambda module: (module.visual_encoder,))

    def caption(self, frame: Frame) -> Caption:
        """Tags of the frame's colour image."""
        return self._network.run(lambda loaded: self._caption(frame, loaded))

    def close(self) -> None:
        """Release the network."""
        self._network.close()

    def _caption(self, frame: Frame, loaded: Loaded[TagList]) -> Caption:
        known = loaded.helper
        described = None if known.described is None else loaded.tensor(known.described)
        logits = loaded.module(loaded.tensor(square_image(frame.color, known.image)), described)
        probable = torch.sigmoid(logits.double()).cpu().numpy()
        return Caption(tags=tuple(tag for tag, yes in zip(known.tags, probable > known.thresholds, strict=True) if yes))

    def _load(self, weights: Weights) -> tuple[Any, TagList]:
        network, size = load(weights)
        if self._config.tag_list is None:
            tags = read_tags(weights.folder, "tags_ram.txt", size.tags)
            thresholds = read_thresholds(weights.folder, "tags_ram_thresholds.txt", size.tags)
            return network, TagList(tags=tags, thresholds=thresholds, described=None, image=size.swin.image)
        descriptions = read_descriptions(self._config.tag_list)
        described = embed_descriptions(list(descriptions.values()))
        thresholds = np.full(len(descriptions), OPEN_THRESHOLD)
        return network, TagList(
            tags=tuple(descriptions), thresholds=thresholds, described=described, image=size.swin.image
        )


def load(weights: Weights) -> tuple[RamPlusNetwork, RamPlusSize]:
    """The network from a model's folder, and its sizes."""
    size = read_architecture(weights.folder, RamPlusSize())
    network = read_checkpoint(weights, lambda: RamPlusNetwork(size), renamed={"vision_multi": "tagging_head"})
    return network, size
