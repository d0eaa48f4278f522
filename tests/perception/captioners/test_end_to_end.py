"""From pictures to a map, with each captioner chosen by its name and tiny random weights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest

from tests.perception.captioners import seeded
from tests.perception.foundation import tiny
from tests.perception.foundation.test_end_to_end import Pictures, configuration
from uppm import open_map
from uppm.core.config import Config, RetrievalConfig
from uppm.core.types import Provenance
from uppm.perception.fakes import FakeRetriever, FakeTextEncoder
from uppm.perception.models.network import COMMAND
from uppm.perception.registry import CAPTIONERS
from uppm.pipeline import Mapper, map_sequence

pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)

from tests.perception.captioners import test_florence2, test_ram_plus, test_tag2text  # need torch

NOUNS = ["chair", "table", "lamp", "cup", "book"]


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
    segmenter = seeded.Noting()
    mapper = Mapper(config, segmenter=segmenter, retriever=FakeRetriever())
    for seed in (1, 2):
        mapper.integrate(seeded.frame(seed))
    mapper.close()
    assert mapper.report.frames == 2
    assert [submap for submap in mapper.map.submaps if submap.descriptor]
    first = {label.text for label in segmenter.asked[0]}
    assert some & first
    assert all(label.provenance in (Provenance.TAG, Provenance.CAPTION) for label in segmenter.asked[0])


def words(models: Path) -> None:
    """`vocabulary` needs no network."""


RUNS: list[tuple[str, Callable[[Path], Any], str]] = [
    ("tag2text", test_tag2text.write_checkpoint, "uppm"),
    ("ram_plus", ram_plus, "paper"),
    ("florence2", lambda models: test_florence2.write_checkpoint(models, "florence-2-large"), "uppm"),
    ("vocabulary", words, "labels"),
]
"""Captioner, what writes its tiny network, method of retrieval."""


def test_every_captioner_and_every_retrieval_has_its_run() -> None:
    assert {name for name, *_ in RUNS} == CAPTIONERS.keys() - {"none", "simulated"}
    assert {method for *_, method in RUNS} == set(get_args(RetrievalConfig.model_fields["method"].annotation))


@pytest.mark.heavy
@pytest.mark.parametrize(("captioner", "make", "retrieval"), RUNS, ids=[name for name, *_ in RUNS])
def test_from_pictures_to_a_map_file_by_the_configuration_alone(
    models: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    captioner: str,
    make: Callable[[Path], Any],
    retrieval: str,
) -> None:
    """Captioner, detector, masks, retrieval, fusion; made up are only the vectors of words that do not ship."""
    make(models)
    tiny.made("grounding_dino", models)
    tiny.made("sam", models, "sam-vit-huge")
    # What Florence-2's random weights answer is put into words.
    said = "</s><s>red chair<loc_1><loc_2><loc_3><loc_4></s>"
    monkeypatch.setattr("transformers.Florence2Processor.batch_decode", lambda self, ids, **options: [said] * len(ids))
    monkeypatch.setattr("uppm.perception.captioners.florence2.MAX_TOKENS", 4)
    monkeypatch.setattr("uppm.perception.retrieval.mpnet.MpnetEncoder", lambda: FakeTextEncoder(768))
    few = tmp_path / "tags.txt"
    few.write_text("".join(f"{noun}\n" for noun in NOUNS))
    own = {"tag_list": few} if captioner == "vocabulary" else {}
    chosen = configuration(profile="foundation", captioner=captioner, **own)
    config = chosen.model_copy(update={"retrieval": RetrievalConfig.model_validate({"method": retrieval})})
    assert map_sequence(Pictures(), tmp_path / "m.uppm", config).frames == 3
    found = {r.text for s in open_map(tmp_path / "m.uppm").submaps if s.descriptor for r in s.descriptor.labels}
    assert found
    assert captioner not in ("ram_plus", "vocabulary") or found <= set(NOUNS)
    assert captioner != "florence2" or "red chair" in found
