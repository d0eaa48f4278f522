"""Noun phrases of a caption, by their part-of-speech tags (paper section 3.2.1)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from uppm.perception.labels.tagger import tagger
from uppm.perception.labels.wordnet import mostly_a_thing
from uppm.perception.labels.words import COLORS

_TOKEN = re.compile(r"\w+(?:[-'\u2019]\w+)*|[^\w\s]")
_NOUN = ("NN", "NNS", "NNP", "NNPS")
_ADJECTIVE = ("JJ", "JJR", "JJS")
_PARTICIPLE = ("VBN", "VBD", "VBG")
_BEFORE_PARTICIPLE = ("DT", "PRP$", "CD", "IN", "CC", ",", ".", "JJ", "POS", "")
"""What stands before a participle that describes a noun: `a framed picture`, not `a wall framed by`."""


@dataclass(frozen=True, kw_only=True)
class Phrase:
    """Modifiers and nouns that stand together: `two red arm chairs`."""

    modifiers: tuple[str, ...]
    """As written, lower case."""
    nouns: tuple[str, ...]
    """The head noun is the last."""
    before: tuple[str, ...]
    """Articles, possessives and numbers that it begins with."""
    counted: bool
    """A number is among them."""
    start: int
    """Word at which it begins, articles included."""
    end: int
    """Word behind it."""


def tokenize(caption: str) -> list[str]:
    """Words and punctuation marks, lower case: models write captions either way."""
    return _TOKEN.findall(caption.lower().replace("_", " "))


def noun_phrases(words: Sequence[str]) -> list[Phrase]:
    """All noun phrases, in order; what `of` joins is still apart."""
    tags = pos_tags(words)
    found: list[Phrase] = []
    position = 0
    while position < len(words):
        end = _phrase_end(words, tags, position)
        if end > position:
            found.append(_phrase(words, tags, position, end))
        position = max(end, position + 1)
    return found


def pos_tags(words: Sequence[str]) -> list[str]:
    """A Penn Treebank tag for each word of a caption or question."""
    return _mended(words, tagger().tag(words))


def _mended(words: Sequence[str], tags: list[str]) -> list[str]:
    """Tags without the newspaper's habits: `trash can` has no modal verb, and a cat `on a sofa sleeping` is no sofa."""
    mended = [*tags, ""]
    for i, word in enumerate(words):
        before = mended[i - 1] if i else ""
        if word == "can" and before in (*_NOUN, *_ADJECTIVE, "DT") and not mended[i + 1].startswith("VB"):
            mended[i] = "NN"
        if tags[i] == "NN" and word.endswith("ing") and before in _NOUN and not mostly_a_thing(word):
            mended[i] = "VBG"
    return mended[:-1]


def _phrase_end(words: Sequence[str], tags: Sequence[str], start: int) -> int:
    """Behind the longest run from `start` that ends in a noun; `start` itself where there is none."""
    end = start
    for position in range(start, len(words)):
        if not _belongs(words, tags, position, start):
            break
        if tags[position] in _NOUN:
            end = position + 1
    return end


def _belongs(words: Sequence[str], tags: Sequence[str], position: int, start: int) -> bool:
    tag, before = tags[position], tags[position - 1] if position else ""
    after = tags[position + 1] if position + 1 < len(tags) else ""
    if tag in _ADJECTIVE:
        return position == start or before not in _NOUN or after in _NOUN
    if tag in _PARTICIPLE:
        return before in _BEFORE_PARTICIPLE and after in (*_NOUN, *_ADJECTIVE)
    if tag == "CC":
        return position > start and _joins_colors(words, position)
    return tag in _NOUN or (tag == "POS" and position > start)


def _joins_colors(words: Sequence[str], position: int) -> bool:
    return words[position - 1] in COLORS and position + 1 < len(words) and words[position + 1] in COLORS


def _phrase(words: Sequence[str], tags: Sequence[str], start: int, end: int) -> Phrase:
    first_noun = next(i for i in range(start, end) if tags[i] in _NOUN or tags[i] == "VBG")
    begin = start
    while begin and tags[begin - 1] in ("DT", "PRP$", "CD", "PDT", "RB"):
        begin -= 1
    return Phrase(
        modifiers=tuple(words[start:first_noun]),
        nouns=tuple(words[first_noun:end]),
        before=tuple(words[begin:start]),
        counted="CD" in tags[begin:start],
        start=begin,
        end=end,
    )


def sentences(words: Sequence[str]) -> Iterator[list[str]]:
    """The words of each sentence."""
    sentence: list[str] = []
    for word in words:
        sentence.append(word)
        if word in ".!?;":
            yield sentence
            sentence = []
    if sentence:
        yield sentence
