"""Dynamic descriptors: elementary descriptors accumulate, the category is put to the vote (paper section 3.3)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from uppm.core.categories import category_of
from uppm.core.features import VisualFeature
from uppm.core.types import Category, DynamicDescriptor, ElementaryDescriptor, LabelRecord


def observe(
    descriptor: DynamicDescriptor | None, seen: ElementaryDescriptor, frame: int, weight: float
) -> DynamicDescriptor:
    """The descriptor after one more observation.

    Parameters
    ----------
    descriptor : DynamicDescriptor or None
        None for a new submap.
    seen : ElementaryDescriptor
    frame : int
        Index of the frame.
    weight : float
        Weight of the vote, positive.
    """
    record = LabelRecord(
        text=seen.label,
        category=seen.category.id,
        count=1,
        weight=weight,
        provenance=(seen.provenance,),
        first_frame=frame,
        last_frame=frame,
    )
    feature = None if seen.feature is None else VisualFeature(mean=seen.feature, count=1)
    if descriptor is None:
        return DynamicDescriptor(labels=(record,), category=seen.category, confidence=1.0, feature=feature)
    feature = _mean(descriptor.feature, feature)
    return _vote(_accumulate((*descriptor.labels, record)), descriptor.category, feature)


def merge(kept: DynamicDescriptor, other: DynamicDescriptor) -> DynamicDescriptor:
    """The descriptor of two submaps that turn out to be one; the kept one's category is the incumbent."""
    return _vote(_accumulate((*kept.labels, *other.labels)), kept.category, _mean(kept.feature, other.feature))


def _mean(a: VisualFeature | None, b: VisualFeature | None) -> VisualFeature | None:
    """Running mean, in the single precision that the map file keeps: a resumed run goes on with the same bits."""
    if a is None or b is None:
        return a or b
    count = a.count + b.count
    mean = a.mean + (b.mean - a.mean) * np.float32(b.count / count)
    return VisualFeature(mean=mean.astype(np.float32), count=count)


def _accumulate(records: Iterable[LabelRecord]) -> tuple[LabelRecord, ...]:
    by_text: dict[tuple[str, int], LabelRecord] = {}
    for r in records:
        key = (r.text, r.category)
        old = by_text.get(key)
        by_text[key] = (
            r
            if old is None
            else replace(
                old,
                count=old.count + r.count,
                weight=old.weight + r.weight,
                provenance=tuple(dict.fromkeys((*old.provenance, *r.provenance))),
                first_frame=min(old.first_frame, r.first_frame),
                last_frame=max(old.last_frame, r.last_frame),
            )
        )
    return tuple(sorted(by_text.values(), key=lambda r: (-r.count, -r.weight, r.text)))


def _vote(labels: tuple[LabelRecord, ...], incumbent: Category, feature: VisualFeature | None) -> DynamicDescriptor:
    """Majority over all accumulated labels; on a tie the incumbent stays."""
    votes: defaultdict[int, float] = defaultdict(float)
    for record in labels:
        votes[record.category] += record.weight
    best = max(votes, key=lambda c: (votes[c], c == incumbent.id, -c))
    if votes[best] <= votes.get(incumbent.id, 0.0):
        winner = incumbent
    else:
        winner = category_of(next(record for record in labels if record.category == best))
    total = sum(votes.values())
    return DynamicDescriptor(labels=labels, category=winner, confidence=votes[winner.id] / total, feature=feature)
