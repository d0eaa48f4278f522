"""From pictures to a map, with each captioner chosen by its name and tiny random weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.perception.captioners import seeded
from uppm.core.config import Config
from uppm.core.types import Frame, Label, PanopticSegmentation, Provenance
from uppm.perception.fakes import FakeRetriever, FakeSegmenter
from uppm.perception.models.network import COMMAND
from uppm.pipeline import Mapper

pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)

from tests.perception.captioners import test_ram_plus, test_tag2text  # need torch

NOUNS = ["chair", "table", "lamp", "cup", "book"]


class Noting(FakeSegmenter):
    """FakeSegmenter that notes what it is asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[tuple[Label, ...]] = []

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        self.asked.append(tuple(labels))
        return super().segment(frame, labels)


def ram_plus(models: Path) -> None:
    folder = test_ram_plus.write_checkpoint(models)
    (folder / "tags.txt").write_text("".join(f"{noun}\n" for noun in NOUNS * 8))


@pytest.mark.parametrize(
    ("captioner", "make", "some"),
    [("tag2text", test_tag2text.write_checkpoint, {"beaver", "creature"}), ("ram_plus", ram_plus, set(NOUNS))],
)
def test_what_is_said_of_a_picture_is_looked_for_in_it(
    models: Path, captioner: str, make: object, some: set[str]
) -> None:
    assert callable(make)
    make(models)
    config = Config.model_validate({"perception": {"captioner": captioner, "threads": 1}})
    segmenter = Noting()
    mapper = Mapper(config, segmenter=segmenter, retriever=FakeRetriever())
    for seed in (1, 2):
        mapper.integrate(seeded.frame(seed))
    mapper.close()
    assert mapper.report.frames == 2
    assert [submap for submap in mapper.map.submaps if submap.descriptor]
    first = {label.text for label in segmenter.asked[0]}
    assert some & first
    assert all(label.provenance in (Provenance.TAG, Provenance.CAPTION) for label in segmenter.asked[0])
