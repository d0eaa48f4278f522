"""Part-of-speech tags by Honnibal's averaged perceptron (paper section 3.2.1; Honnibal 2013, Collins 2002).

The weights ship with the package. NLTK has the same tagger, but reads weights only from data folders of its own and
brings seven packages for these forty lines; `tests/perception/labels/data/tags_nltk.tsv` holds its answers.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib import resources

START, END = ("-START-", "-START2-"), ("-END-", "-END2-")


class Tagger:
    """Greedy from left to right: each word's tag has the highest sum of the weights of its features.

    Parameters
    ----------
    weights : mapping
        Feature -> tag -> weight.
    tag_of : mapping
        Word -> tag, of words that hardly ever have another.
    classes : sequence of str
        All tags (Penn Treebank).
    """

    def __init__(
        self, weights: Mapping[str, Mapping[str, float]], tag_of: Mapping[str, str], classes: Sequence[str]
    ) -> None:
        self._weights, self._tag_of, self._classes = weights, tag_of, classes

    def tag(self, words: Sequence[str]) -> list[str]:
        """One tag a word."""
        context = [*START, *map(_normal, words), *END]
        before, before2 = START
        tags: list[str] = []
        for position, word in enumerate(words):
            tag = self._tag_of.get(word) or self._best(
                _features(word, context[position : position + 5], before, before2)
            )
            tags.append(tag)
            before, before2 = tag, before
        return tags

    def _best(self, features: Iterator[str]) -> str:
        scores: defaultdict[str, float] = defaultdict(float)
        for feature in features:
            for tag, weight in self._weights.get(feature, {}).items():
                scores[tag] += weight
        return max(self._classes, key=lambda tag: (scores[tag], tag))


def _normal(word: str) -> str:
    if "-" in word and word[0] != "-":
        return "!HYPHEN"
    if word.isdigit() and len(word) == 4:
        return "!YEAR"
    return "!DIGITS" if word[0].isdigit() else word.lower()


def _features(word: str, context: Sequence[str], before: str, before2: str) -> Iterator[str]:
    """What speaks for a tag: the word, two neighbours on either side (`context` of five) and the tags so far."""
    left2, left, middle, right, right2 = context
    yield "bias"
    yield f"i suffix {word[-3:]}"
    yield f"i pref1 {word[0]}"
    yield f"i-1 tag {before}"
    yield f"i-2 tag {before2}"
    yield f"i tag+i-2 tag {before} {before2}"
    yield f"i word {middle}"
    yield f"i-1 tag+i word {before} {middle}"
    yield f"i-1 word {left}"
    yield f"i-1 suffix {left[-3:]}"
    yield f"i-2 word {left2}"
    yield f"i+1 word {right}"
    yield f"i+1 suffix {right[-3:]}"
    yield f"i+2 word {right2}"


@cache
def tagger() -> Tagger:
    """The shipped tagger, read at the first call (0.1 s)."""
    import zstandard

    data = resources.files("uppm.data").joinpath("tagger.json.zst").read_bytes()
    model = json.loads(zstandard.ZstdDecompressor().decompress(data))
    return Tagger(dict(zip(model["features"], model["weights"], strict=True)), model["tag_of"], model["classes"])
