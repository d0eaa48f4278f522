"""What prompts find, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from uppm.evaluation.language import PromptOutcome, auroc, language_metrics


def outcome(
    prompt: str, meaning: str, wanted: list[set[int]], answers: tuple[int, ...], probability: float
) -> PromptOutcome:
    return PromptOutcome(
        prompt=prompt,
        meaning=meaning,
        wanted=tuple(map(frozenset, wanted)),
        answers=answers,
        probability=probability,
    )


def test_hand_computed() -> None:
    found = language_metrics(
        [
            outcome("sofa", "couch", [{1}], (1,), 0.9),
            outcome("couch", "couch", [{1}], (4, 1), 0.8),
            outcome("settee", "couch", [{1}], (), 0.3),
            # Two chairs, one of them in two pieces: one of the pieces is enough.
            outcome("chair", "chair", [{2, 3}, {5}], (3, 4), 0.7),
            # The map lacks the cup.
            outcome("cup", "cup", [set()], (9,), 0.6),
            outcome("bicycle", "", [], (), 0.2),
            outcome("zebra", "", [], (4,), 0.65),
        ]
    )
    assert (found.prompts_present, found.prompts_absent) == (5, 2)
    assert found.query_top1 == pytest.approx(2 / 5)
    assert found.query_recall == pytest.approx((1 + 1 + 0 + 0.5 + 0) / 5)
    assert found.query_recall_worst == pytest.approx((0 + 0.5 + 0) / 3)
    assert found.query_false_answers == pytest.approx(1 / 2)
    # Of the ten pairs, all five above 0.2, and 0.9, 0.8, 0.7 above 0.65.
    assert found.query_auroc_absent == pytest.approx(8 / 10)


def test_without_prompts_of_a_kind() -> None:
    found = language_metrics([outcome("sofa", "couch", [{1}], (1,), 0.9)])
    assert found.query_false_answers is None
    assert found.query_auroc_absent is None
    assert language_metrics([]).query_recall is None


def test_ties_count_half() -> None:
    assert auroc(np.array([0.5, 0.5]), np.array([True, False])) == 0.5
