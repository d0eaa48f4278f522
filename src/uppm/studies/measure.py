"""Map a sequence with some settings, and measure the map: surface, instances, answers to every name."""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from uppm.core.config import Config, RetrievalConfig
from uppm.core.types import Submap, SubmapKind, SubmapState
from uppm.evaluation.ground_truth import SurfaceTruth, load_surface_truth
from uppm.evaluation.instances import MIN_PIXELS, InstanceMatch
from uppm.evaluation.language import PromptOutcome, language_metrics
from uppm.evaluation.map_evaluation import Reconstruction, evaluate_map
from uppm.evaluation.sampling import SurfacePart
from uppm.map.panoptic_map import PanopticMap
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.perception.simulated.names import name_table
from uppm.pipeline import map_sequence, open_map, open_sequence

POINTS_PER_M2 = 2_500
"""A quarter of what `uppm evaluate map` samples, since a study measures many maps."""
PROGRAM_ONLY = ("matches", "per_class")
"""What `evaluate_map` gives that fits no table."""


def measure(sequence: Path, config: Config) -> dict[str, Any]:
    """The metrics of docs/evaluation.md, and those of the answers to every name, of the map of a sequence."""
    source = open_sequence(sequence, config.input)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "study.uppm"
        report = map_sequence(source, file, config)
        panoptic_map = open_map(file)
        found = measure_map(panoptic_map, load_surface_truth(sequence))
    skipped = sum(report.skipped.values())
    return {"frames": report.frames, "frames_skipped": skipped, **found}


def measure_map(panoptic_map: PanopticMap, truth: SurfaceTruth) -> dict[str, Any]:
    """Surface, instances and answers of one map."""
    parts = tuple(map(partial(_part, panoptic_map), mapped(panoptic_map)))
    reconstruction = unified(Reconstruction(source="map", parts=parts))
    evaluation = evaluate_map(reconstruction, truth, points_per_m2=POINTS_PER_M2)
    matches = evaluation.instances.matches if evaluation.instances else ()
    answers = language_metrics(name_outcomes(panoptic_map, matches, truth))
    flat = {key: value for key, value in evaluation.to_dict().items() if key not in PROGRAM_ONLY}
    return flat | asdict(answers)


def mapped(panoptic_map: PanopticMap) -> list[Submap]:
    """What a map claims to be there."""
    solid = (s for s in panoptic_map.submaps if s.kind is not SubmapKind.FREESPACE)
    return [s for s in solid if s.state is not SubmapState.TENTATIVE]


def _part(panoptic_map: PanopticMap, submap: Submap) -> SurfacePart:
    d = submap.descriptor
    return SurfacePart(
        id=submap.id,
        mesh=panoptic_map.submap_mesh(submap.id),
        category=d.category.name if d else None,
        is_object=submap.kind is SubmapKind.OBJECT,
        score=d.confidence if d else 0.0,
    )


def unified(reconstruction: Reconstruction) -> Reconstruction:
    """The parts under unified categories, so that maps whose labels are categories can be compared with others."""
    retriever = create_retriever(RetrievalConfig(), LabelEmbeddings())
    names = sorted({part.category for part in reconstruction.parts if part.category})
    category = dict(zip(names, (c.name for c in retriever.retrieve(names)), strict=True))
    parts = (replace(part, category=category.get(part.category or "")) for part in reconstruction.parts)
    return replace(reconstruction, parts=tuple(parts))


def name_outcomes(
    panoptic_map: PanopticMap, matches: Sequence[InstanceMatch], truth: SurfaceTruth
) -> list[PromptOutcome]:
    """Every name of every visible thing asked for, and the names of things that are not there."""
    wanted: dict[str, list[frozenset[int]]] = defaultdict(list)
    meaning: dict[str, str] = {}
    for name, row in name_table().items():
        for text in map(lemmatize, row.names):
            meaning.setdefault(text, name)
            wanted[text] += [frozenset(m.submaps) for m in matches if m.is_thing and m.name == name]
    # What was seen in a few pixels only, or is floor or wall, is neither there nor absent.
    unclear = {i.name for i in truth.instances.values() if i.pixels and (not i.is_thing or i.pixels < MIN_PIXELS)}
    unsure = {lemmatize(text) for name in unclear & set(name_table()) for text in name_table()[name].names}
    return [
        _outcome(panoptic_map, text, meaning[text], submaps)
        for text, submaps in sorted(wanted.items())
        if submaps or text not in unsure
    ]


def _outcome(panoptic_map: PanopticMap, text: str, meaning: str, submaps: Sequence[frozenset[int]]) -> PromptOutcome:
    result = panoptic_map.query(text, limit=len(panoptic_map.submaps))
    best = (*result.results, *result.closest)
    return PromptOutcome(
        prompt=text,
        meaning=meaning,
        wanted=tuple(submaps),
        answers=tuple(answer.submap.id for answer in result.results),
        probability=best[0].probability if best else 0.0,
    )
