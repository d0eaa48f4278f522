"""Label text -> its normal form: lower case, no articles, the head noun in the singular (method.md section 1).

After WordNet's Morphy: a list of exceptions first, then endings that are detached. Morphy asks WordNet which candidate
is a word; here the endings that are ambiguous without a dictionary (-ves, -oes, -ies, -ses) are settled by lists.
"""

from __future__ import annotations

import re
from functools import lru_cache

_IRREGULAR = {
    "men": "man", "women": "woman", "children": "child", "feet": "foot", "teeth": "tooth", "geese": "goose",
    "mice": "mouse", "lice": "louse", "oxen": "ox", "dwarves": "dwarf",
    "shelves": "shelf", "bookshelves": "bookshelf", "knives": "knife", "leaves": "leaf", "loaves": "loaf",
    "wolves": "wolf", "calves": "calf", "halves": "half", "scarves": "scarf", "hooves": "hoof", "thieves": "thief",
    "wives": "wife", "lives": "life", "elves": "elf", "sheaves": "sheaf", "wharves": "wharf", "handkerchieves":
    "handkerchief", "buses": "bus", "lenses": "lens", "gases": "gas", "viruses": "virus", "cactuses": "cactus",
    "cacti": "cactus", "canvases": "canvas", "atlases": "atlas", "irises": "iris", "walruses": "walrus",
    "platypuses": "platypus", "fungi": "fungus", "radii": "radius", "bases": "base", "axes": "axe", "quizzes": "quiz",
    "shoes": "shoe", "snowshoes": "snowshoe", "horseshoes": "horseshoe", "toes": "toe", "canoes": "canoe",
    "oboes": "oboe", "hoes": "hoe", "aloes": "aloe", "headaches": "headache", "caches": "cache", "niches": "niche",
    "quiches": "quiche", "mustaches": "mustache", "avalanches": "avalanche",
}  # fmt: skip
_KEEP_IE_TEXT = """
cookies movies brownies ties neckties pies magpies zombies selfies hoodies smoothies collies beanies veggies onesies
walkies talkies pixies rookies genies birdies calories prairies lies budgies aunties boogies bookies hippies junkies
newbies groupies foodies undies cuties sorties plushies
"""
_INVARIANT_TEXT = """
glasses eyeglasses sunglasses goggles binoculars scissors shears pliers tweezers clippers tongs pants trousers jeans
shorts tights leggings overalls pajamas pyjamas clothes underpants stairs downstairs skis headquarters barracks
series species news tennis billiards darts chess gas bus lens canvas atlas iris christmas bias asparagus hummus
citrus cactus hibiscus octopus walrus platypus virus campus circus status trellis chassis oasis basis analysis axis
clematis ibis pelvis portcullis always perhaps molasses lotus crocus eucalyptus minibus omnibus trolleybus radius
fungus stimulus thermos asbestos cosmos rhinoceros chaos dress glass swiss sassafras pancreas alas overseas dais
marquis debris louis paris texas suds dregs cutlass
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
_KEEP_IE, _INVARIANT, _ARTICLES, _NUMBERS, _EYEWEAR, _PREPOSITIONS = (
    frozenset(text.split())
    for text in (_KEEP_IE_TEXT, _INVARIANT_TEXT, _ARTICLES_TEXT, _NUMBERS_TEXT, _EYEWEAR_TEXT, _PREPOSITIONS_TEXT)
)
"""Plurals of words in -ie; words without a singular; what a label may begin with; what goes with the plural; whose
`glasses` are worn, not drunk from; what ends the head of a phrase."""


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
    """A noun's lemma; a word that is not a plural comes back as it is."""
    if noun in _IRREGULAR:
        return _IRREGULAR[noun]
    if noun in _INVARIANT or len(noun) < 4 or not noun.endswith("s") or noun.endswith(("ss", "us", "is")):
        return noun
    if noun.endswith("ies"):
        return noun[:-1] if noun in _KEEP_IE else noun[:-3] + "y"
    if noun.endswith(("sses", "xes", "ches", "shes", "zzes", "oes")):
        return noun[:-2]
    return noun[:-1]
