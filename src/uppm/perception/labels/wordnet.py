"""WordNet's nouns, shipped (Miller 1995): which words are nouns, what each is a kind of, and irregular forms."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib import resources


@dataclass(frozen=True, kw_only=True, eq=False)
class WordNet:
    """The tables of `wordnet.json.zst`; a synset is a position in `synsets`."""

    synsets: tuple[str, ...]
    """Offset of each synset in WordNet 3.0's data.noun: its name across programs."""
    hypernyms: tuple[str, ...]
    """The synsets that each is a kind of, as text."""
    senses: Mapping[str, str]
    """Noun -> its synsets as text, the commonest sense first."""
    no_nouns: frozenset[str]
    """Verbs, adjectives and adverbs that are never nouns."""
    noun_exceptions: Mapping[str, str]
    """Irregular plural -> singular."""

    def synsets_of(self, noun: str) -> tuple[int, ...]:
        """The senses of a lemma, the commonest first; empty for what is no noun."""
        return tuple(map(int, self.senses.get(noun, "").split()))

    def ancestors(self, synset: int) -> Iterator[tuple[int, int]]:
        """(synset, steps) of the synset itself and all that it is a kind of, nearest first, each once."""
        layer, seen, steps = [synset], {synset}, 0
        while layer:
            yield from ((s, steps) for s in layer)
            above = [int(h) for s in layer for h in self.hypernyms[s].split()]
            layer = [s for s in dict.fromkeys(above) if s not in seen]
            seen.update(layer)
            steps += 1

    def is_a(self, synset: int, offset: str) -> bool:
        """Whether a synset is, or is a kind of, the one with that offset."""
        return any(self.synsets[s] == offset for s, _ in self.ancestors(synset))


@cache
def wordnet() -> WordNet:
    """The shipped tables, read at the first call (30 ms)."""
    import zstandard

    data = resources.files("uppm.data").joinpath("wordnet.json.zst").read_bytes()
    tables = json.loads(zstandard.ZstdDecompressor().decompress(data))
    return WordNet(
        synsets=tuple(tables["synsets"].split("\n")),
        hypernyms=tuple(tables["hypernyms"].split("\n")),
        senses=dict(zip(tables["nouns"].split("\n"), tables["senses"].split("\n"), strict=True)),
        no_nouns=frozenset(tables["no_nouns"].split("\n")),
        noun_exceptions=tables["noun_exceptions"],
    )


PHYSICAL = "1930"
"""Synset `physical entity`."""
SENSES = 4
"""Rarer senses do not count."""


@lru_cache(maxsize=65536)
def names_a_thing(noun: str) -> bool:
    """Whether a phrase can name something physical: it, or its end, has such a sense in WordNet, or none at all."""
    words = noun.split()
    known = [synsets for i in range(len(words)) if (synsets := wordnet().synsets_of(" ".join(words[i:])))]
    return not known or any(wordnet().is_a(s, PHYSICAL) for synsets in known for s in synsets[:SENSES])


def mostly_a_thing(noun: str) -> bool:
    """Whether the commonest sense of a noun is something physical: `painting`, not `sleeping`."""
    synsets = wordnet().synsets_of(noun)
    return bool(synsets) and wordnet().is_a(synsets[0], PHYSICAL)


def may_be_a_noun(word: str) -> bool:
    """Whether a word is a noun in WordNet, or at least no other word that WordNet has: `smartphone`."""
    return word in wordnet().senses or word not in wordnet().no_nouns
