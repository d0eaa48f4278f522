"""Caption and tags -> labels with provenance (VLFE++, paper section 3.2.1; docs/labels.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from uppm.core.language import Caption, FrameLabels
from uppm.core.protocols import Captioner, Closable
from uppm.core.types import Frame, Label, Provenance
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.labels.phrases import Phrase, noun_phrases, sentences, tokenize
from uppm.perception.labels.wordnet import may_be_a_noun, names_a_thing
from uppm.perception.labels.words import ACTIONS, ALWAYS_STOP, BLURRY, COLORS, DEPICTIONS, MEASURES, STOP, THIS, VAGUE

BLURRED = "caption calls it blurry"
NO_THING = "label names no object"


class CaptionLabeler:
    """Labels by what an image-to-text model writes.

    Parameters
    ----------
    captioner : Captioner
    use_tags : bool
        Tags become labels too.
    skip_blurry : bool
        A frame whose caption calls it blurry is skipped.
    """

    def __init__(self, captioner: Captioner, *, use_tags: bool = True, skip_blurry: bool = True) -> None:
        self._captioner, self._use_tags, self._skip_blurry = captioner, use_tags, skip_blurry

    def label(self, frame: Frame) -> FrameLabels:
        """The labels of a frame; `skip` says that it is blurry."""
        caption = self._captioner.caption(frame)
        if self._skip_blurry and is_blurry(caption.text):
            return FrameLabels(skip=BLURRED)
        return parse_caption(caption, use_tags=self._use_tags)

    def close(self) -> None:
        """Release what the captioner holds."""
        if isinstance(self._captioner, Closable):
            self._captioner.close()


def is_blurry(text: str) -> bool:
    """Whether a caption calls its image blurry: `a blurry photo of a desk`."""
    return not BLURRY.isdisjoint(tokenize(text.lower().replace("out of focus", "out-of-focus")))


def parse_caption(caption: Caption, *, use_tags: bool = True) -> FrameLabels:
    """Labels of what an image-to-text model wrote: those of the caption, then those that only its tags name."""
    dropped = Counter[str]()
    found: dict[str, Provenance] = {}
    for text in _labels(caption.text, dropped):
        found.setdefault(text, Provenance.CAPTION)
    for tag in caption.tags if use_tags else ():
        for text in _labels(tag, dropped) if " " in tag.strip() else _bare_noun(tag, dropped):
            found.setdefault(text, Provenance.TAG)
    labels = tuple(Label(text=text, provenance=provenance) for text, provenance in found.items())
    return FrameLabels(labels=labels, dropped=dict(dropped))


def _labels(text: str, dropped: Counter[str]) -> list[str]:
    """Label texts of a caption or tag, in order."""
    out: list[str] = []
    for sentence in sentences(tokenize(text)):
        for label in _joined(noun_phrases(sentence), sentence):
            if label:
                out.append(label)
            else:
                dropped[NO_THING] += 1
    return out


def _bare_noun(tag: str, dropped: Counter[str]) -> list[str]:
    """A tag of one word: it has no context that would tell a noun from a verb, so lists decide."""
    lemma = lemmatize(tag)
    if lemma in STOP | COLORS | ACTIONS or not may_be_a_noun(lemma) or not names_a_thing(lemma):
        dropped[NO_THING] += 1
        return []
    return [lemma]


def _joined(phrases: Sequence[Phrase], words: Sequence[str]) -> Iterator[str]:
    """The label of each phrase, or of two joined by `of`; empty for those that name no object."""
    position = 0
    while position < len(phrases):
        phrase, following = phrases[position], phrases[position + 1 : position + 2]
        position += 1
        if not following or words[phrase.end : following[0].start] != ["of"]:
            yield label_of(phrase)
            continue
        head, content = lemmatize(phrase.nouns[-1]), following[0]
        if head in MEASURES:
            continue
        if head == "picture" and phrase.start == 0:
            yield ""
        elif head in DEPICTIONS and head not in STOP:
            position += 1
            yield label_of(phrase)
        elif head in STOP or content.before:
            yield label_of(phrase)
        else:
            position += 1
            text = label_of(phrase)
            yield f"{text} of {' '.join((*content.modifiers, *content.nouns))}" if text else ""


def label_of(phrase: Phrase) -> str:
    """Modifiers and nouns of a phrase, its head in the singular; empty for what names no object."""
    modifiers = [word for word in phrase.modifiers if word not in VAGUE]
    text = " ".join((*modifiers, *phrase.nouns)).replace(" 's ", "'s ")
    lemma = lemmatize(f"two {text}" if phrase.counted else text)
    head = lemma.split()[-1] if lemma else ""
    itself = lemma == "picture" and not THIS.isdisjoint(phrase.before)
    nothing = head in (STOP if len(phrase.nouns) == 1 else ALWAYS_STOP)
    return "" if itself or nothing or not names_a_thing(lemma) else lemma
