"""What a map answers to a list of prompts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.types import SubmapKind
from uppm.evaluation.language import PromptOutcome, language_metrics
from uppm.evaluation.prompts import Prompt, Wanted
from uppm.map.mesh import merged
from uppm.map.panoptic_map import PanopticMap
from uppm.map.render import choose_view, render


class Found(Enum):
    """How often a submap was among the answers to the prompts that mean it; each with its colour."""

    ALWAYS = (92, 172, 108)
    SOMETIMES = (238, 172, 62)
    NEVER = (206, 52, 60)
    NOT_ASKED = (196, 200, 206)

    @property
    def meaning(self) -> str:
        """In words, for a legend."""
        return _MEANINGS[self]


_MEANINGS = {
    Found.ALWAYS: "found by every prompt that means it",
    Found.SOMETIMES: "by some of them",
    Found.NEVER: "by none",
    Found.NOT_ASKED: "nothing asks for it",
}


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


def draw_answers(panoptic_map: PanopticMap, outcomes: Sequence[PromptOutcome]) -> npt.NDArray[np.uint8]:
    """The map from above at a slant, each submap in the colour of how often it was found; (H, W, 3) RGB."""
    found = how_often_found(outcomes)
    submaps = [s for s in panoptic_map.submaps if s.kind is not SubmapKind.FREESPACE]
    meshes = [panoptic_map.submap_mesh(submap.id) for submap in submaps]
    colors = [found.get(submap.id, Found.NOT_ASKED).value for submap in submaps]
    mesh = merged([replace(m, colors=np.full_like(m.colors, color)) for m, color in zip(meshes, colors, strict=True)])
    bounds = np.quantile(mesh.vertices, [0.001, 0.999], axis=0) if len(mesh.vertices) else np.zeros((2, 3))
    return render(mesh, choose_view(bounds, panoptic_map.up), width=1200, height=750).image


def how_often_found(outcomes: Sequence[PromptOutcome]) -> dict[int, Found]:
    """Of each submap that a prompt means."""
    meant, answered = Counter[int](), Counter[int]()
    for outcome in outcomes:
        wanted = frozenset[int]().union(*outcome.wanted)
        meant.update(wanted)
        answered.update(wanted & set(outcome.answers))
    return {
        submap: Found.ALWAYS if answered[submap] == times else Found.SOMETIMES if answered[submap] else Found.NEVER
        for submap, times in meant.items()
    }
