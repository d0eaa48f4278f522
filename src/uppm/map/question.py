"""A small grammar over part-of-speech tags: what a sentence asks of a map (docs/query.md).

    question   := ["how many" | "where is" | "is there" | "what is" | "which"] thing [("is" | "are") predicate]
    predicate  := ["the"] superlative | colour
    thing      := {article} [superlative] {colour} noun [connector thing]
                | ... "between" thing "and" thing
    connector  := a relation, or "to", "nearest to", "farthest from"

A connector belongs to the noun before it, so that "the cup on the table next to the bed" is a cup on such a table.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from uppm.map.colors import color_name

Tagger = Callable[[Sequence[str]], Sequence[str]]
"""Words -> a Penn Treebank tag each."""
Word = tuple[str, str]
"""Text and tag."""

_PHRASES = {
    "on": ("on top of", "on", "upon", "atop"),
    "under": ("under", "underneath", "beneath"),
    "below": ("below",),
    "above": ("above", "over"),
    "in": ("in", "inside", "inside of", "within"),
    "next to": ("next to", "beside", "by", "near", "close to", "adjacent to", "alongside"),
    "between": ("between", "in between"),
    "left of": ("left of", "to the left of", "on the left of", "on the left side of"),
    "right of": ("right of", "to the right of", "on the right of", "on the right side of"),
    "in front of": ("in front of", "before"),
    "behind": ("behind", "in back of"),
    "against": ("against", "along", "at"),
    "in the same room as": (
        "in the same room as",
        "in the same room with",
        "in the room with",
        "in a room with",
        "in the room of",
    ),
    "nearest": ("nearest to", "closest to", "to", "from"),
    "farthest": ("farthest from", "furthest from", "farthest away from", "furthest away from"),
}
CONNECTORS = sorted(
    ((tuple(text.split()), name) for name, texts in _PHRASES.items() for text in texts), key=lambda c: -len(c[0])
)
"""(words, what they mean), the longest first."""
SUPERLATIVES = {
    "largest": "largest",
    "biggest": "largest",
    "smallest": "smallest",
    "littlest": "smallest",
    "tiniest": "smallest",
    "tallest": "tallest",
    "shortest": "shortest",
    "longest": "longest",
    "widest": "longest",
    "highest": "highest",
    "topmost": "highest",
    "lowest": "lowest",
    "nearest": "nearest",
    "closest": "nearest",
    "farthest": "farthest",
    "furthest": "farthest",
}
TO_SOMETHING = ("nearest", "farthest")
COUNTS = (("how", "many"), ("number", "of"), ("count",))
QUESTION_WORDS = frozenset(["what", "which", "where", "how", "find", "show", "list", "count"])
ANYTHING = frozenset(["thing", "things", "object", "objects", "item", "items", "something", "anything", "everything"])
AUXILIARIES = frozenset(["is", "are", "there", "that", "me", "of", "all", "do", "does", "i", "you", "see"])
"""They say nothing at either end of a noun phrase."""
_IDLE_TAGS = ("DT", "PDT", "EX", "WDT", "WP", "WRB", "PRP", "PRP$", "CD", "MD")
_NOUN_TAGS = ("NN", "JJ", "POS", "VBN", "VBG", "CD", "DT", "FW", "RB")
"""Beginnings of the tags that may stand in a noun phrase."""


@dataclass(frozen=True, kw_only=True)
class Thing:
    """What a noun phrase asks for."""

    noun: str | None
    """As written, with the modifiers that are no colours; None: anything."""
    colors: tuple[str, ...] = ()
    """By their names in the table of colours; all must be there."""
    superlative: str | None = None
    relation: str | None = None
    """To `others`: a key of `relations.RELATIONS`."""
    others: tuple[Thing, ...] = ()
    """What it is related to, or is nearest to or farthest from."""

    def __str__(self) -> str:
        words = [*filter(None, [self.superlative]), *self.colors, self.noun or "thing"]
        if self.others:
            link = {"nearest": "to", "farthest": "from"}.get(self.superlative or "", "") if not self.relation else ""
            words += [self.relation or link, " and ".join(f"[{other}]" for other in self.others)]
        return " ".join(words)


@dataclass(frozen=True, kw_only=True)
class Question:
    """What a sentence asks."""

    thing: Thing
    count: bool
    """How many there are, not which."""

    def __str__(self) -> str:
        return f"how many: {self.thing}" if self.count else str(self.thing)


def parse(text: str, tag: Tagger) -> Question | None:
    """What a sentence asks; None where the grammar does not cover it."""
    words = tokens(text)
    count = next((c for c in COUNTS if tuple(words[: len(c)]) == c), ())
    tagged = list(zip(words, tag(words), strict=True))[len(count) :]
    thing = _thing(_fronted(tagged))
    return Question(thing=thing, count=bool(count)) if thing else None


def _fronted(tagged: Sequence[Word]) -> list[Word]:
    """With a predicate before its noun: `which chairs are white` asks for white chairs."""
    verb = next((i for i, (word, _) in enumerate(tagged) if word in ("is", "are")), len(tagged))
    asked = [word for word in tagged[:verb] if word[0] not in QUESTION_WORDS]
    said = [word for word in tagged[verb + 1 :] if word[0] not in ("the", "one", "ones", "and")]
    if not asked or asked[-1][0] in ("room", "rooms"):  # Of which nothing can be asked.
        return list(tagged)
    if not said or not all(color_name(word) or word in SUPERLATIVES for word, _ in said):
        return list(tagged)
    return [*sorted(said, key=lambda word: word[0] not in SUPERLATIVES), *asked]


def is_question(text: str) -> bool:
    """Whether a text asks for more than a plain phrase does: `red` and `cup on the table`, not `cup of coffee`.

    A connector without anything behind it relates to nothing: `something to sit on`.
    """
    words = tokens(text)
    if QUESTION_WORDS & set(words) or any(word in SUPERLATIVES for word in words):
        return True
    first = next((c for c in (_connector(words, i) for i in range(len(words))) if c), None)
    related = first is not None and first[0] > 0 and first[1] < len(words) and _connector(words, len(words) - 1) is None
    return related or any(color_name(word) for word in words[:-1])


def tokens(text: str) -> list[str]:
    """Words, lower case, without punctuation."""
    return re.findall(r"\w+(?:[-'\u2019]\w+)*", text.lower())


def _connector(words: Sequence[str], start: int) -> tuple[int, int, str] | None:
    """(start, end, meaning) of the longest connector at a place."""
    for phrase, name in CONNECTORS:
        if tuple(words[start : start + len(phrase)]) == phrase:
            return start, start + len(phrase), name
    return None


def _thing(tagged: Sequence[Word]) -> Thing | None:
    words = [word for word, _ in tagged]
    found = next((c for c in (_connector(words, i) for i in range(len(words))) if c), None)
    if found is None:
        return _noun_phrase(tagged)
    start, end, name = found
    head = _noun_phrase(tagged[:start])
    others = _others(tagged[end:], name)
    if head is None or others is None:
        return None
    if name not in TO_SOMETHING:
        return replace(head, relation=name, others=others)
    if head.superlative is None and words[start:end] not in (["to"], ["from"]):
        return replace(head, superlative=name, others=others)
    return replace(head, others=others) if head.superlative in TO_SOMETHING else None


def _others(tagged: Sequence[Word], name: str) -> tuple[Thing, ...] | None:
    """What a connector leads to: one thing, or two for `between`."""
    parts = [tagged]
    if name == "between":
        at = next((i for i, (word, _) in enumerate(tagged) if word == "and"), None)
        if at is None:
            return None
        parts = [tagged[:at], tagged[at + 1 :]]
    things = [_thing(part) for part in parts]
    known = tuple(thing for thing in things if thing and (thing.noun or thing.others))
    return known if len(known) == len(parts) else None


def _noun_phrase(tagged: Sequence[Word]) -> Thing | None:
    """A thing without relations; None for what is no noun phrase."""
    left = _bare(tagged)
    if not left:
        asked = any(word in QUESTION_WORDS for word, _ in tagged)
        return Thing(noun=None) if asked else None
    superlative = SUPERLATIVES.get(left[0][0])
    if superlative:
        left = left[1:]
    colors: list[str] = []
    while len(left) > 1 and (name := color_name(left[0][0])):
        colors.append(name)
        left = left[2:] if left[1][0] == "and" and len(left) > 2 else left[1:]
    if not left or not all(t.startswith(_NOUN_TAGS) or word in ("of", "and", "can") for word, t in left):
        return None
    noun = " ".join(word for word, _ in left)
    return Thing(noun=None if noun in ANYTHING else noun, colors=tuple(colors), superlative=superlative)


def _bare(tagged: Sequence[Word]) -> list[Word]:
    """Without articles, question words and verbs before, and verbs behind: `which [chair] is standing`."""
    left = list(tagged)
    while left and (left[0][0] in AUXILIARIES | QUESTION_WORDS or left[0][1] in _IDLE_TAGS or _is_verb(left, 0)):
        left = left[1:]
    while len(left) > 1 and (left[-1][0] in AUXILIARIES or _is_verb(left, len(left) - 1)):
        left = left[:-1]
    return left


def _is_verb(words: Sequence[Word], at: int) -> bool:
    """By its tag; a participle before a noun describes it: `framed picture`."""
    word, tag = words[at]
    if word in ("stands", "hangs", "lies", "sits"):  # Nouns to the tagger, after `what`.
        return True
    describes = tag in ("VBN", "VBG") and at + 1 < len(words)
    return tag.startswith("VB") and not describes
