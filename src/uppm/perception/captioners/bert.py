"""BERT with cross-attention to another modality, named as the checkpoints of BLIP's family; for back ends alone.

transformers' BERT no longer has a cross-attention whose keys are wider than its queries. Shapes: B texts, T tokens,
C channels, S tokens to attend to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional


@dataclass(frozen=True, kw_only=True)
class BertSize:
    """What tells one BERT from another."""

    width: int = 768
    layers: int = 12
    heads: int = 12
    inner: int = 3072
    """Width of the feed-forward layers."""
    vocabulary: int = 30524
    """bert-base-uncased's, and one token each for the start of an encoder's and a decoder's text."""
    positions: int = 512
    source: int = 768
    """Channels of what the cross-attention attends to."""

    def attending(self, source: int) -> BertSize:
        """The same, for a source of so many channels."""
        return replace(self, source=source)


BERT_BASE = BertSize()
TAGGING_HEAD = BertSize(layers=2, heads=4)
"""Of Query2Label's kind."""
Keys = tuple[Tensor, Tensor]
"""Keys and values of an attention, (B, heads, T, C / heads) each; one row serves all rows of the queries."""
Cache = list[Keys]
"""The same for each layer."""


class Bert(nn.Module):
    """Layers of self-attention, cross-attention and feed-forward; as a tagging head without the first, and no words."""

    def __init__(self, size: BertSize, *, words: bool = True) -> None:
        super().__init__()
        if words:
            self.embeddings = Embeddings(size)
        self.encoder = Encoder(size, attention=words)

    @property
    def _layers(self) -> list[Layer]:
        return cast("list[Layer]", list(self.encoder.layer))

    def encode(self, ids: Tensor, mask: Tensor, source: Tensor) -> Tensor:
        """Tokens (B, T) that all see one another where `mask` (B, T) is true -> (B, T, C)."""
        states = self.embeddings(ids, 0)
        for layer, seen in zip(self._layers, self.sources(source), strict=True):
            states = layer(states, layer.attention.keys(states), seen, mask[:, None, None, :])
        return states

    def decode(self, ids: Tensor, sources: Cache, past: Cache) -> tuple[Tensor, Cache]:
        """The next tokens (B, T), each of which sees those before it, the past ones too -> (B, T, C) and all so far."""
        before, length = past[0][0].shape[2] if past else 0, ids.shape[1]
        mask = torch.ones(length, before + length, dtype=torch.bool, device=ids.device).tril(before)
        states, cache = self.embeddings(ids, before), Cache()
        for i, (layer, seen) in enumerate(zip(self._layers, sources, strict=True)):
            k, v = layer.attention.keys(states)
            cache.append((torch.cat([past[i][0], k], dim=2), torch.cat([past[i][1], v], dim=2)) if past else (k, v))
            states = layer(states, cache[i], seen, mask)
        return states, cache

    def sources(self, source: Tensor) -> Cache:
        """Keys and values of each layer's cross-attention to a source (B, S, C)."""
        return [layer.crossattention.keys(source) for layer in self._layers]

    def cross(self, states: Tensor, source: Tensor) -> Tensor:
        """Queries (B, T, C) that see the source alone, as a tagging head's do -> (B, T, C)."""
        for layer, seen in zip(self._layers, self.sources(source), strict=True):
            states = layer.feed(layer.crossattention(states, seen))
        return states


class Encoder(nn.Module):
    def __init__(self, size: BertSize, *, attention: bool) -> None:
        super().__init__()
        self.layer = nn.ModuleList(Layer(size, attention=attention) for _ in range(size.layers))


class Embeddings(nn.Module):
    def __init__(self, size: BertSize) -> None:
        super().__init__()
        self.word_embeddings = nn.Embedding(size.vocabulary, size.width)
        self.position_embeddings = nn.Embedding(size.positions, size.width)
        self.LayerNorm = nn.LayerNorm(size.width, eps=1e-12)

    def forward(self, ids: Tensor, first: int) -> Tensor:
        positions = torch.arange(first, first + ids.shape[1], device=ids.device)
        return self.LayerNorm(self.word_embeddings(ids) + self.position_embeddings(positions))


class Layer(nn.Module):
    def __init__(self, size: BertSize, *, attention: bool) -> None:
        super().__init__()
        if attention:
            self.attention = Attention(size.width, size.width, size.heads)
        self.crossattention = Attention(size.width, size.source, size.heads)
        self.intermediate = Dense(size.width, size.inner)
        self.output = Residual(size.inner, size.width)

    def forward(self, states: Tensor, own: Keys, source: Keys, mask: Tensor) -> Tensor:
        return self.feed(self.crossattention(self.attention(states, own, mask), source))

    def feed(self, states: Tensor) -> Tensor:
        return self.output(functional.gelu(self.intermediate.dense(states)), states)


class Dense(nn.Module):
    def __init__(self, width: int, inner: int) -> None:
        super().__init__()
        self.dense = nn.Linear(width, inner)


class Projections(nn.Module):
    def __init__(self, width: int, source: int) -> None:
        super().__init__()
        self.query = nn.Linear(width, width)
        self.key, self.value = nn.Linear(source, width), nn.Linear(source, width)


class Attention(nn.Module):
    def __init__(self, width: int, source: int, heads: int) -> None:
        super().__init__()
        self._heads = heads
        self.self = Projections(width, source)
        self.output = Residual(width, width)

    def keys(self, source: Tensor) -> Keys:
        """What each token of a source (B, S, C) offers."""
        return self._split(self.self.key(source)), self._split(self.self.value(source))

    def forward(self, states: Tensor, keys: Keys, mask: Tensor | None = None) -> Tensor:
        k, v = (part.expand(len(states), -1, -1, -1) for part in keys)
        out = functional.scaled_dot_product_attention(self._split(self.self.query(states)), k, v, attn_mask=mask)
        return self.output(out.transpose(1, 2).flatten(2), states)

    def _split(self, states: Tensor) -> Tensor:
        return states.unflatten(2, (self._heads, -1)).transpose(1, 2)


class Residual(nn.Module):
    """norm(dense(x) + what it was made of)."""

    def __init__(self, inner: int, width: int) -> None:
        super().__init__()
        self.dense = nn.Linear(inner, width)
        self.LayerNorm = nn.LayerNorm(width, eps=1e-12)

    def forward(self, states: Tensor, residual: Tensor) -> Tensor:
        return self.LayerNorm(self.dense(states) + residual)


class Transform(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.dense = nn.Linear(width, width)
        self.LayerNorm = nn.LayerNorm(width, eps=1e-12)


class Predictions(nn.Module):
    def __init__(self, size: BertSize) -> None:
        super().__init__()
        self.transform = Transform(size.width)
        self.decoder = nn.Linear(size.width, size.vocabulary)
        # One parameter under two names, both of which checkpoints hold.
        self.bias = self.decoder.bias


class WordHead(nn.Module):
    """States -> a logit a word, as `cls` of BERT's checkpoints."""

    def __init__(self, size: BertSize) -> None:
        super().__init__()
        self.predictions = Predictions(size)

    def forward(self, states: Tensor) -> Tensor:
        head = self.predictions
        return head.decoder(head.transform.LayerNorm(functional.gelu(head.transform.dense(states))))
