"""The profile `simulated`: what a prompted detector and mask generator would give, made from ground truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.types import Detections, Frame, GroundTruth, Label, PanopticSegmentation, Provenance, Segment
from uppm.perception.labels.lemma import head_index, lemmatize
from uppm.perception.segmentation.assembly import assemble
from uppm.perception.segmentation.suppression import suppress
from uppm.perception.simulated.masks import Mask, box_around, grown, inside, neighbour, noisy_box, split
from uppm.perception.simulated.names import normal_names
from uppm.perception.simulated.noise import BoxNoise, FalseTag, FrameNoise, InstanceNoise, frame_noise
from uppm.perception.simulated.truth import ground_truth


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One box that the detector gives, and the mask in it."""

    box: npt.NDArray[np.float64]
    """(4,): x0, y0, x1, y1 in pixels."""
    mask: Mask
    segment: Segment


class SimulatedSegmenter:
    """Finds what it is asked for by name; each frame's noise depends on that frame alone."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Nothing to learn from the sequence."""

    def segment(self, frame: Frame, labels: Sequence[Label]) -> PanopticSegmentation:
        """Segments of the instances that the labels ask for, and of what the detector takes for them.

        Raises
        ------
        InputError
            The sequence has no ground truth.
        """
        truth = ground_truth(frame)
        noise = frame_noise(frame, truth, self._config.simulated)
        prompts = {label.text: label.provenance for label in labels}
        candidates = [*self._found(truth, noise, prompts), *_false_alarms(truth, noise.false_tags, prompts)]
        candidates = [c for c in candidates if c.mask.any()]
        kept, dropped = self._suppressed(candidates)
        dropped += Counter(simulated_without_prompt=self._unasked(noise, prompts))
        return assemble(frame, [(c.mask, c.segment) for c in kept], self._min_pixels(), dropped)

    def _suppressed(self, candidates: Sequence[Candidate]) -> tuple[list[Candidate], Counter[str]]:
        """Stuff is left alone: floor and wall may both reach from edge to edge, and are no duplicates."""
        things = [c for c in candidates if c.segment.is_thing]
        keep, dropped = suppress(_detections(things), self._config)
        return [things[i] for i in keep] + [c for c in candidates if not c.segment.is_thing], Counter(dropped)

    def _min_pixels(self) -> int:
        """At level 0 nothing is too small, as in ground truth."""
        return max(1, round(min(self._config.simulated.level, 1.0) * self._config.min_mask_pixels))

    @staticmethod
    def _unasked(noise: FrameNoise, prompts: Mapping[str, Provenance]) -> int:
        return sum(not i.missed and _prompt(i, prompts) is None for i in noise.instances)

    def _found(self, truth: GroundTruth, noise: FrameNoise, prompts: Mapping[str, Provenance]) -> Iterator[Candidate]:
        swallowed: set[int] = set()
        for i in noise.instances:
            label = None if i.missed or i.instance in swallowed else _prompt(i, prompts)
            if label is None:
                continue
            mask = truth.instance == i.instance
            if i.merged and (other := neighbour(truth.instance, mask, truth.things - swallowed)):
                swallowed.add(other)
                mask |= truth.instance == other
            for part in split(mask, i.split) if i.split is not None else (mask,):
                if part.any():
                    yield from _boxes(part, i, label, _second(i, label, prompts))


def _boxes(mask: Mask, i: InstanceNoise, label: Label, second: Label | None) -> Iterator[Candidate]:
    """The first box, the second under another name, and the smaller one inside."""
    yield _candidate(mask, i, label, i.boxes[0])
    if second is not None:
        yield _candidate(mask, i, second, i.boxes[1])
    if i.part is not None:
        box = box_around(mask)
        low, size = box[:2], box[2:] - box[:2]
        part = inside(mask, np.concatenate([low + i.part[:2] * size, low + i.part[2:] * size]))
        if part.any():
            yield _candidate(part, i, label, i.boxes[2])


def _candidate(mask: Mask, i: InstanceNoise, label: Label, noise: BoxNoise) -> Candidate:
    height, width = mask.shape
    box = noisy_box(box_around(mask), noise, (height, width))
    segment = Segment(label=label, score=noise.score, is_thing=i.is_thing)
    return Candidate(box=box, mask=grown(mask, noise.grow), segment=segment)


def _prompt(i: InstanceNoise, prompts: Mapping[str, Provenance]) -> Label | None:
    """The label under which an instance is found: what it is called now, or else its tag, or any right name of it."""
    texts = (grounded(name, prompts) for name in (i.name, i.tag, *normal_names(i.truth)))
    text = next((text for text in texts if text is not None), None)
    return None if text is None else Label(text=text, provenance=prompts[text])


def _second(i: InstanceNoise, label: Label, prompts: Mapping[str, Provenance]) -> Label | None:
    """The other label that finds it again: the caption's second name for it, or its tag."""
    again = [(i.other_name, Provenance.CAPTION)] if i.duplicated else []
    again += [(i.tag, Provenance.TAG)] if i.in_tags else []
    texts = [text for text, source in again if prompts.get(lemmatize(text)) is source]
    others = [lemmatize(text) for text in texts if lemmatize(text) != label.text]
    return Label(text=others[0], provenance=prompts[others[0]]) if others else None


def grounded(name: str, prompts: Mapping[str, Provenance]) -> str | None:
    """The prompt for a phrase: itself, or the longest that is a part of it with its head.

    Captions are parsed into labels, which may be parts of what was meant: 'sink' of 'sink with a tap'.
    """
    phrase = lemmatize(name)
    if phrase in prompts:
        return phrase
    head = phrase.split()[head_index(phrase.split())]
    parts = (text for text in prompts if f" {text} " in f" {phrase} " and head in text.split())
    return max(parts, key=len, default=None)


def _false_alarms(
    truth: GroundTruth, tags: Sequence[FalseTag], prompts: Mapping[str, Provenance]
) -> Iterator[Candidate]:
    """What the detector finds for a tag of something that is not there: a piece of what is in its place."""
    height, width = truth.instance.shape
    size = np.array([width, height])
    for tag in tags:
        text = lemmatize(tag.name)
        if prompts.get(text) is not Provenance.TAG:
            continue
        center = np.array(tag.center) * (size - 1)
        low, high = np.maximum(center - tag.size * size / 2, 0), np.minimum(center + tag.size * size / 2, size)
        box = np.concatenate([low, np.maximum(high, low + 1)])
        x, y = center.astype(int)
        mask = inside(truth.instance == truth.instance[y, x], box)
        segment = Segment(label=Label(text=text, provenance=Provenance.TAG), score=tag.score, is_thing=True)
        yield Candidate(box=box, mask=mask, segment=segment)


def _detections(candidates: Sequence[Candidate]) -> Detections:
    return Detections(
        boxes=np.array([c.box for c in candidates], dtype=np.float32).reshape(-1, 4),
        scores=np.array([c.segment.score for c in candidates], dtype=np.float32),
        labels=tuple(c.segment.label for c in candidates),
    )
