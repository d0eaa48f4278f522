"""Beam search over a decoder's words, as transformers 4.25 (which Tag2Text is written for) does it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

Step = Callable[[Tensor, Any], tuple[Tensor, Any]]
"""New tokens (B, T) and state -> logits of the next word (B, V) and the new state."""
Reorder = Callable[[Any, Tensor], Any]
"""State and rows (B,) -> the state of those rows."""


@dataclass(frozen=True, kw_only=True)
class BeamOptions:
    end: int
    """The token that ends a text."""
    beams: int = 3
    """1: greedy."""
    min_length: int = 10
    """Tokens before which a text may not end; as all lengths here, the prompt counts."""
    max_length: int = 50


def beam_search(prompt: Sequence[int], step: Step, reorder: Reorder, options: BeamOptions, device: Any) -> list[int]:
    """The most probable text that begins with the prompt, by mean log-probability a token; the end token left out."""
    tokens = torch.tensor([prompt] * options.beams, device=device)
    scores = torch.full((options.beams,), -1e9, device=device)
    scores[0] = 0  # the rows are equal at first, and only one may speak
    found, state, new = _Finished(options.beams), None, tokens
    while True:
        logits, state = step(new, state)
        best, rows, words = _candidates(logits, scores, tokens.shape[1], options)
        ended = found.take(best, rows, words, tokens, options.end)
        if ended:
            break
        going = [i for i, word in enumerate(words) if word != options.end][: options.beams]
        chosen = torch.tensor([rows[i] for i in going], device=device)
        new = torch.tensor([[words[i]] for i in going], device=device)
        scores = torch.tensor([best[i] for i in going], device=device)
        tokens, state = torch.cat([tokens[chosen], new], dim=1), reorder(state, chosen)
        if tokens.shape[1] >= options.max_length:
            for row, score in zip(tokens.tolist(), scores.tolist(), strict=True):
                found.add(score, row)
            break
    return found.best()


def _candidates(
    logits: Tensor, scores: Tensor, length: int, options: BeamOptions
) -> tuple[list[float], list[int], list[int]]:
    """Score, row and word of the 2 B best continuations, best first."""
    logs = torch.log_softmax(logits.float(), dim=-1)
    if length < options.min_length:
        logs[:, options.end] = -torch.inf
    best, index = (logs + scores[:, None]).flatten().topk(2 * options.beams)
    words = logs.shape[1]
    return best.tolist(), (index // words).tolist(), (index % words).tolist()


class _Finished:
    """The best texts that have ended."""

    def __init__(self, keep: int) -> None:
        self._keep, self._texts = keep, list[tuple[float, list[int]]]()

    def add(self, score: float, tokens: list[int]) -> None:
        self._texts.append((score / len(tokens), tokens))
        self._texts.sort(key=lambda text: text[0])
        del self._texts[: -self._keep]

    def take(self, best: list[float], rows: list[int], words: list[int], tokens: Tensor, end: int) -> bool:
        """Add the continuations that end; says whether none of the others can become better."""
        for score, row, word in list(zip(best, rows, words, strict=True))[: self._keep]:
            if word == end:
                self.add(score, tokens[row].tolist())
        if self._keep == 1:
            return words[0] == end
        full = len(self._texts) == self._keep
        return full and self._texts[0][0] >= best[0] / tokens.shape[1]

    def best(self) -> list[int]:
        return self._texts[-1][1]
