"""A fixed vocabulary in place of a captioner: what it says, and that all of it is looked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from uppm.core.config import PerceptionConfig
from uppm.core.errors import InputError
from uppm.core.types import Provenance
from uppm.perception.captioners.vocabulary import indoors
from uppm.perception.fakes import fake_frame
from uppm.perception.registry import create_labeler


def test_without_a_list_it_is_what_stands_in_rooms() -> None:
    found = create_labeler(PerceptionConfig(captioner="vocabulary")).label(fake_frame())
    said = [label.text for label in found.labels]
    assert len(said) == len(set(said))
    assert {"chair", "door", "wall", "floor", "cup", "potted plant", "refrigerator"} <= set(said)
    assert not {"zebra", "car", "snow", "wall-brick", "textile-other", "door-stuff"} & set(said)
    assert all(label.provenance is Provenance.TAG for label in found.labels)
    assert len(said) >= len(indoors()) - 2  # hardly any is refused as no noun


def test_words_of_one_s_own(tmp_path: Path) -> None:
    words = tmp_path / "words.txt"
    words.write_text("espresso machine\nwall\n\nbonsai\n")
    labeler = create_labeler(PerceptionConfig(captioner="vocabulary", tag_list=words))
    assert [label.text for label in labeler.label(fake_frame()).labels] == ["espresso machine", "wall", "bonsai"]
    with pytest.raises(InputError, match=r"expected a list of tags"):
        create_labeler(PerceptionConfig(captioner="vocabulary", tag_list=tmp_path / "none.txt"))
