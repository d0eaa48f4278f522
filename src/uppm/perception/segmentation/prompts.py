"""Labels as prompts of a text-conditioned detector: cleaned, each once, in one order, in rows that fit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.types import Detections, Label, Provenance
from uppm.perception.models.network import Weights

MAX_WORDS = 24
"""A label is a phrase; what is longer is cut."""
Tokenize = Callable[[str], list[int]]
"""Word -> token ids, without special tokens."""
Found = tuple[Label, float, npt.NDArray[np.float32]]
"""Label, score, and box as centre, width and height in shares of the image."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Processor:
    """What stands before a network that looks and reads: transformers' image processor and tokenizer."""

    image: Any
    tokenizer: Any

    @classmethod
    def load(cls, weights: Weights, image: str, **settings: Any) -> Processor:
        """From a model's folder; `image` names the image processor's class, `settings` are put in place of its own."""
        import transformers

        return cls(
            image=getattr(transformers, image).from_pretrained(weights.folder, **settings),
            tokenizer=transformers.AutoTokenizer.from_pretrained(weights.folder),
        )


@dataclass(frozen=True, kw_only=True)
class Phrase:
    """One prompt as tokens."""

    label: Label
    tokens: tuple[int, ...]
    head: slice
    """Where in the tokens its head noun stands: what the phrase is of, as chair in `red chair`."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """Phrases that a model reads as one text, `[CLS] phrase . phrase . [SEP]`."""

    phrases: tuple[Phrase, ...]
    starts: tuple[int, ...]
    """Position of each phrase's first token."""
    tokens: tuple[int, ...]


def unique_labels(labels: Iterable[Label]) -> dict[str, Label]:
    """Prompt text -> label, sorted by text. Of two labels with one text the one from a caption stays."""
    by_text: dict[str, Label] = {}
    for label in labels:
        text = " ".join(re.sub(r"[.?]", " ", label.text.lower()).split()[:MAX_WORDS])
        if text and (text not in by_text or label.provenance is Provenance.CAPTION):
            by_text[text] = label
    return dict(sorted(by_text.items()))


def phrases(labels: Iterable[Label], tokenize: Tokenize) -> list[Phrase]:
    """The labels as phrases, in the order of their texts."""
    out: list[Phrase] = []
    for text, label in unique_labels(labels).items():
        words = [tokenize(word) for word in text.split()]
        # `cup of coffee`: the head stands before the first `of`.
        head = len(text.split(" of ")[0].split()) - 1
        first = sum(map(len, words[:head]))
        tokens = tuple(token for word in words for token in word)
        if tokens:
            out.append(Phrase(label=label, tokens=tokens, head=slice(first, first + len(words[head]))))
    return out


def pack(phrases: Sequence[Phrase], first: int, stop: int, last: int, *, max_tokens: int, together: bool) -> list[Row]:
    """Rows of at most `max_tokens`, in the order given; `together`: as many phrases a row as fit, else one."""
    rows: list[list[Phrase]] = []
    room = 0
    for phrase in phrases:
        needed = len(phrase.tokens) + 1
        if not together or needed > room:
            rows.append([])
            room = max_tokens - 2
        rows[-1].append(phrase)
        room -= needed
    return [_row(row, first, stop, last) for row in rows]


def _row(phrases: Sequence[Phrase], first: int, stop: int, last: int) -> Row:
    tokens, starts = [first], []
    for phrase in phrases:
        starts.append(len(tokens))
        tokens += [*phrase.tokens, stop]
    return Row(phrases=tuple(phrases), starts=tuple(starts), tokens=(*tokens, last))


def detections(found: Iterable[Found], shape: Sequence[int]) -> Detections:
    """Boxes in pixels of an image (H, W, ...), best first; equal scores in the order of the labels' texts."""
    rows = sorted(found, key=lambda f: (-f[1], f[0].text))
    boxes = np.array([box for *_, box in rows], dtype=np.float32).reshape(-1, 4)
    limits = np.array([shape[1], shape[0]] * 2, dtype=np.float32)
    corners = np.concatenate([boxes[:, :2] - boxes[:, 2:] / 2, boxes[:, :2] + boxes[:, 2:] / 2], axis=1)
    return Detections(
        boxes=np.minimum(np.maximum(corners * limits, 0), limits),
        scores=np.array([score for _, score, _ in rows], dtype=np.float32),
        labels=tuple(label for label, *_ in rows),
    )
