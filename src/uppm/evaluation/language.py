"""How well a map answers: the right object first, all of them, and 'not here' where it is not (method.md section 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import rankdata


@dataclass(frozen=True, kw_only=True)
class PromptOutcome:
    """One prompt, what is right for it, and what the map said."""

    prompt: str
    meaning: str
    """What it stands for; prompts of one meaning are synonyms and paraphrases of each other."""
    wanted: tuple[frozenset[int], ...]
    """For each object that is meant, the submaps that are it: none where the map lacks it. Empty: it is not there."""
    answers: tuple[int, ...]
    """Submaps that the map answered with, the most probable first."""
    probability: float
    """That of the most probable submap, answered with or not; 0 to 1."""

    @property
    def is_absent(self) -> bool:
        """Nothing in the scene is meant."""
        return not self.wanted

    @property
    def first_is_right(self) -> bool:
        """The first answer is one of the objects meant."""
        return bool(self.answers) and any(self.answers[0] in submaps for submaps in self.wanted)

    @property
    def recall(self) -> float:
        """Share of the objects meant that are among the answers."""
        return sum(bool(submaps & set(self.answers)) for submaps in self.wanted) / len(self.wanted)


@dataclass(frozen=True, kw_only=True)
class LanguageMetrics:
    """Shares from 0 to 1; None where no prompt asks for it."""

    prompts_present: int
    prompts_absent: int
    query_top1: float | None
    """Prompts of what is there whose first answer is right."""
    query_recall: float | None
    """Mean share of the objects meant that are among the answers."""
    query_recall_worst: float | None
    """Over the meanings, the lowest recall of one of their prompts, averaged: synonyms should not matter."""
    query_false_answers: float | None
    """Prompts of what is not there that were answered."""
    query_auroc_absent: float | None
    """Area under the ROC curve of 'it is there' by the probability of the best submap; None without both kinds."""


def language_metrics(outcomes: Sequence[PromptOutcome]) -> LanguageMetrics:
    """Top-1, recall and the separation of what is not there, over all prompts."""
    present = [o for o in outcomes if not o.is_absent]
    absent = [o for o in outcomes if o.is_absent]
    worst: dict[str, float] = {}
    for outcome in present:
        worst[outcome.meaning] = min(outcome.recall, worst.get(outcome.meaning, 1.0))
    return LanguageMetrics(
        prompts_present=len(present),
        prompts_absent=len(absent),
        query_top1=_mean([o.first_is_right for o in present]),
        query_recall=_mean([o.recall for o in present]),
        query_recall_worst=_mean(list(worst.values())),
        query_false_answers=_mean([bool(o.answers) for o in absent]),
        query_auroc_absent=auroc(
            np.array([o.probability for o in outcomes]), np.array([not o.is_absent for o in outcomes], dtype=bool)
        ),
    )


def auroc(scores: npt.NDArray[np.floating], positive: npt.NDArray[np.bool_]) -> float | None:
    """Chance that a positive scores above a negative, ties half (Mann-Whitney U); None without both.

    Parameters
    ----------
    scores, positive : (N,).
    """
    n, m = int(positive.sum()), int((~positive).sum())
    if not n or not m:
        return None
    return float((rankdata(scores)[positive].sum() - n * (n + 1) / 2) / (n * m))


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
