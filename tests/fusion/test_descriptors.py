"""Label accumulation and the vote (paper section 3.3)."""

from __future__ import annotations

from uppm.core.categories import category_by_name, label_category
from uppm.core.types import ElementaryDescriptor, Provenance
from uppm.fusion.descriptors import merge, observe


def seen(label: str, category: str, provenance: Provenance = Provenance.DETECTOR) -> ElementaryDescriptor:
    return ElementaryDescriptor(label=label, category=category_by_name()[category], provenance=provenance, score=0.5)


def accumulate(*labels: tuple[str, str]):
    descriptor = None
    for frame, (label, category) in enumerate(labels):
        descriptor = observe(descriptor, seen(label, category), frame, 1.0)
    assert descriptor is not None
    return descriptor


def test_labels_are_counted_with_frames_and_provenance() -> None:
    d = accumulate(("sofa", "couch"), ("couch", "couch"), ("sofa", "couch"))
    assert [(r.text, r.count, r.first_frame, r.last_frame) for r in d.labels] == [("sofa", 2, 0, 2), ("couch", 1, 1, 1)]
    d = observe(d, seen("sofa", "couch", Provenance.CAPTION), 9, 1.0)
    assert d.labels[0].provenance == (Provenance.DETECTOR, Provenance.CAPTION)
    assert d.confidence == 1.0


def test_majority_wins_and_the_incumbent_keeps_a_tie() -> None:
    tie = accumulate(("table", "table"), ("dining table", "dining table"))
    assert tie.category.name == "table"
    assert tie.confidence == 0.5
    flipped = accumulate(("table", "table"), ("dining table", "dining table"), ("dining table", "dining table"))
    assert flipped.category.name == "dining table"
    assert len(flipped.labels) == 2


def test_weights_count_in_the_vote() -> None:
    d = observe(None, seen("cup", "cup"), 0, 0.9)
    d = observe(d, seen("vase", "vase"), 1, 0.3)
    d = observe(d, seen("vase", "vase"), 2, 0.3)
    assert d.category.name == "cup"
    assert d.confidence == 0.6


def test_merging_adds_counts() -> None:
    d = merge(accumulate(("sofa", "couch"), ("sofa", "couch")), accumulate(("couch", "couch"), ("sofa", "couch")))
    assert {r.text: r.count for r in d.labels} == {"sofa": 3, "couch": 1}


def test_a_label_that_is_its_own_category_can_win() -> None:
    def own(text: str) -> ElementaryDescriptor:
        return ElementaryDescriptor(label=text, category=label_category(text), provenance=Provenance.TAG, score=0.5)

    d = observe(observe(observe(None, own("sofa"), 0, 1.0), own("couch"), 1, 1.0), own("couch"), 2, 1.0)
    assert d.category == label_category("couch")
    assert (d.category.name, d.category.voxel_size) == ("couch", 0.03)
    assert merge(observe(None, own("settee"), 0, 1.0), d).category.name == "couch"
