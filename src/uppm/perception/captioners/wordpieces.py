"""BERT's word pieces as Tag2Text uses them, with two more tokens: the start of a decoder's and of an encoder's text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError

DECODE, ENCODE = "[DEC]", "[ENC]"
SPECIAL = ("[PAD]", "[CLS]", "[SEP]", "[UNK]")
MAX_TAG_TOKENS = 40
"""Tokens of all tags of an image, padded to as many."""


class WordPieces:
    """Text to token ids and back.

    Parameters
    ----------
    vocabulary : Path
        bert-base-uncased's vocab.txt.
    size : int
        Tokens that the network knows, the two added ones included.

    Raises
    ------
    InputError
        The file cannot be read or has another number of tokens.
    """

    def __init__(self, vocabulary: Path, size: int) -> None:
        tokens = vocabulary.read_text(encoding="utf-8").splitlines()
        special = [tokens.index(name) for name in SPECIAL if name in tokens]
        if len(special) < len(SPECIAL) or len(tokens) != size - 2:
            expected = f"{size - 2} tokens, one a line, with {', '.join(SPECIAL)}"
            advice = "run `uppm models download bert-base-uncased`"
            raise InputError(vocabulary, expected=expected, found=f"{len(tokens)} lines", advice=advice)
        self._pad, _, self.end, _ = special
        self._decode, self._encode = size - 2, size - 1
        self._words = _tokenizer({token: i for i, token in enumerate([*tokens, DECODE, ENCODE])})

    def tags(self, tags: Sequence[str]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        """Ids (40,) of the tags with bars between, and which of them are not padding."""
        words = self._words.encode(" | ".join(tags)).ids[: MAX_TAG_TOKENS - 2]
        ids = np.full(MAX_TAG_TOKENS, self._pad, dtype=np.int64)
        ids[: len(words) + 2] = [self._encode, *words, self.end]
        return ids, np.arange(MAX_TAG_TOKENS) < len(words) + 2

    def prompt(self, text: str) -> list[int]:
        """Ids with which a caption begins."""
        return [self._decode, *self._words.encode(text).ids]

    def text(self, ids: Sequence[int]) -> str:
        """The text of token ids, special ones left out."""
        return self._words.decode(list(ids), skip_special_tokens=True)


def _tokenizer(vocabulary: dict[str, int]) -> Any:
    from tokenizers import Tokenizer, decoders, models, normalizers, pre_tokenizers

    words = Tokenizer(models.WordPiece(vocabulary, unk_token="[UNK]"))
    words.normalizer = normalizers.BertNormalizer(lowercase=True)
    words.pre_tokenizer = pre_tokenizers.BertPreTokenizer()
    words.decoder = decoders.WordPiece()
    words.add_special_tokens([*SPECIAL, DECODE, ENCODE])
    return words
