"""Label text -> its normal form: lower case, no articles, the head noun in the singular (method.md section 1).

WordNet's Morphy: a list of exceptions first, then endings that are detached where WordNet knows what is left.
"""

from __future__ import annotations

import re
from functools import lru_cache

from uppm.perception.labels.wordnet import wordnet

_IRREGULAR = {"people": "person", "axes": "axe", "bases": "base", "cookies": "cookie", "dwarves": "dwarf"}
"""Where WordNet's first answer is not the household's."""
_INVARIANT_TEXT = """
glasses eyeglasses sunglasses goggles binoculars scissors shears pliers tweezers clippers tongs pants trousers jeans
shorts tights leggings overalls pajamas pyjamas clothes underpants stairs downstairs upstairs skis gas always perhaps
this
"""
_ARTICLES_TEXT = """
a an the some any this that these those my your his her its our their
"""
_NUMBERS_TEXT = """
two three four five six seven eight nine ten several many few both
"""
_EYEWEAR_TEXT = """
eye sun reading safety swimming protective prescription vr 3d
"""
_PREPOSITIONS_TEXT = """
of with in on at for to from by near under over behind beside next that which
"""
_INVARIANT, _ARTICLES, _NUMBERS, _EYEWEAR, _PREPOSITIONS = (
    frozenset(text.split())
    for text in (_INVARIANT_TEXT, _ARTICLES_TEXT, _NUMBERS_TEXT, _EYEWEAR_TEXT, _PREPOSITIONS_TEXT)
)
"""Words without a singular; what a label may begin with; what goes with the plural; whose `glasses` are worn, not
drunk from; what ends the head of a phrase."""
_ENDINGS = (
    ("s", ""),
    ("ses", "s"),
    ("xes", "x"),
    ("zes", "z"),
    ("ches", "ch"),
    ("shes", "sh"),
    ("ies", "y"),
    ("men", "man"),
)
"""Morphy's rules of detachment for nouns."""


@lru_cache(maxsize=65536)
def lemmatize(label: str) -> str:
    """The label's normal form: 'The Shelves' -> 'shelf', 'apples' -> 'apple', 'cups_of coffee' -> 'cup of coffee'."""
    words = re.sub(r"[^\w'&]+|_", " ", label.lower()).split()
    while len(words) > 1 and words[0] in _ARTICLES:
        words = words[1:]
    if not words:
        return ""
    head = head_index(words)
    lemma = singular(words[head])
    if words[head] == "glasses" and head and words[head - 1] not in _EYEWEAR:
        lemma = "glass"
    counted = head > 0 and lemma != words[head] and words[0] in _NUMBERS
    words[head] = lemma
    return " ".join(words[1:] if counted else words)


def head_index(words: list[str]) -> int:
    """Where the head noun of an English noun phrase is: before its first preposition, else at the end."""
    return next((i - 1 for i, word in enumerate(words) if i and word in _PREPOSITIONS), len(words) - 1)


def singular(noun: str) -> str:
    """A noun's lemma by WordNet's Morphy, the singular before a plural that has an entry of its own (`shoes`).

    A word that is not a plural comes back as it is; what WordNet does not know loses its ending by rule.
    """
    if noun in _IRREGULAR:
        return _IRREGULAR[noun]
    if noun in _INVARIANT or len(noun) < 3:
        return noun
    if noun in wordnet().noun_exceptions:
        return wordnet().noun_exceptions[noun]
    if noun.endswith(("ss", "us", "is")):
        return noun
    stems = [noun.removesuffix(ending) + by for ending, by in _ENDINGS if noun.endswith(ending)]
    known = next((stem for stem in stems if stem in wordnet().senses), None)
    return known or (noun if noun in wordnet().senses or not stems else stems[-1])
