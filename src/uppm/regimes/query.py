"""What a map answers to a list of prompts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from uppm.evaluation.language import PromptOutcome, language_metrics
from uppm.evaluation.prompts import Prompt, Wanted
from uppm.map.panoptic_map import PanopticMap


def ask(panoptic_map: PanopticMap, prompts: Sequence[Prompt], wanted: Wanted) -> list[PromptOutcome]:
    """The map's answer to each prompt beside what is right."""
    outcomes = []
    for prompt, submaps in zip(prompts, wanted, strict=True):
        answer = panoptic_map.query(prompt.text, limit=max(1, len(panoptic_map.submaps)))
        best = (*answer.results, *answer.closest)
        outcomes.append(
            PromptOutcome(
                prompt=prompt.text,
                meaning="|".join(prompt.objects),
                wanted=submaps,
                answers=tuple(a.submap.id for a in answer.results),
                probability=best[0].probability if best else 0.0,
            )
        )
    return outcomes


def query_result(outcomes: Sequence[PromptOutcome]) -> dict[str, Any]:
    """The figures, and under `answers` what was said to each prompt."""
    answers = [
        {
            "prompt": o.prompt,
            "objects": o.meaning,
            "answers": list(o.answers),
            "probability": round(o.probability, 4),
            "right": not o.answers if o.is_absent else o.first_is_right,
        }
        for o in outcomes
    ]
    return asdict(language_metrics(outcomes)) | {"answers": answers}
