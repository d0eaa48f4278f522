"""Threads of stages that run at once."""

from __future__ import annotations

import pytest

from uppm.core import threads
from uppm.core.config import Config
from uppm.core.threads import usable_cores, within_cores
from uppm.pipeline import Mapper


@pytest.mark.parametrize(
    ("cores", "perception", "fusion", "expected"),
    [(2, 2, 2, (1, 1)), (3, 2, 2, (2, 1)), (4, 2, 2, (2, 2)), (4, 6, 2, (3, 1)), (1, 2, 2, (1, 1)), (8, 1, 16, (1, 7)),
     (2, 16, 1, (1, 1))],
)  # fmt: skip
def test_stages_at_once_take_no_more_than_the_cores(
    monkeypatch: pytest.MonkeyPatch, cores: int, perception: int, fusion: int, expected: tuple[int, int]
) -> None:
    monkeypatch.setattr(threads, "usable_cores", lambda: cores)
    settings = {"perception": {"threads": perception, "ahead": True}, "fusion": {"threads": fusion}}
    shared = within_cores(Config.model_validate(settings))
    assert (shared.perception.threads, shared.fusion.threads) == expected
    settings["perception"]["ahead"] = False
    in_turn = Config.model_validate(settings)
    assert within_cores(in_turn) is in_turn


def test_a_mapper_keeps_to_them_and_notes_what_was_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "usable_cores", lambda: 2)
    config = Config.model_validate({"perception": {"ahead": True, "profile": "groundtruth"}})
    seen = list[int]()
    monkeypatch.setattr("uppm.pipeline.create_segmenter", lambda settings: seen.append(settings.threads))
    mapper = Mapper(config)
    assert seen == [1]
    assert mapper.config == config


def test_this_machine_has_a_core() -> None:
    assert usable_cores() >= 1
