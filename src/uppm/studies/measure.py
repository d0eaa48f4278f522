"""Map a sequence with some settings, and measure the map: surface, instances, answers to every name."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from uppm.core.config import Config, RetrievalConfig
from uppm.evaluation import map_evaluation
from uppm.evaluation.ground_truth import SurfaceTruth, load_surface_truth
from uppm.evaluation.instances import MIN_PIXELS, InstanceMatch
from uppm.evaluation.language import PromptOutcome, language_metrics
from uppm.evaluation.map_evaluation import Comparison, Reconstruction
from uppm.evaluation.panoptic_metrics import PanopticMetrics
from uppm.export.files import write_png
from uppm.map.panoptic_map import PanopticMap
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.perception.simulated.names import name_table
from uppm.regimes.pictures import draw_instances
from uppm.regimes.reconstructions import map_reconstruction
from uppm.studies.mapping import SharedPerception, map_and_segments

PROGRAM_ONLY = ("matches", "per_class")
"""What `evaluate_map` gives that fits no table."""


@lru_cache(maxsize=2)
def _truth(sequence: Path) -> SurfaceTruth:
    """Read once for all runs of a study, and with it the index of its points."""
    return load_surface_truth(sequence)


def measure(sequence: Path, config: Config, picture: Path, shared: SharedPerception | None = None) -> dict[str, Any]:
    """The metrics of docs/evaluation.md, and those of the answers to every name, of the map of a sequence.

    Beside the map's own stand those of the segments that went into it: `pq`, `sq`, `rq`, and `tp` and `fn`, the
    matched and the missed true segments over all frames that are not skipped.

    Parameters
    ----------
    picture : Path
        Where to draw the map's right and wrong instances, PNG.
    shared : SharedPerception, optional
        What other runs of the study saw.
    """
    mapper, segments = map_and_segments(sequence, config, shared or SharedPerception())
    panoptic_map = mapper.map
    found, comparison = measure_map(panoptic_map, _truth(sequence))
    write_png(picture, draw_instances(comparison))
    report = panoptic_map.report
    counts = {"frames": report.frames, "frames_skipped": sum(report.skipped.values())}
    return counts | found | segment_figures(segments)


def segment_figures(segments: PanopticMetrics) -> dict[str, Any]:
    """PQ, SQ, RQ, and the matched and the missed true segments of all classes."""
    counts = {key: sum(getattr(of_class, key) for of_class in segments.per_class.values()) for key in ("tp", "fn")}
    return {"pq": segments.pq, "sq": segments.sq, "rq": segments.rq} | counts


def measure_map(panoptic_map: PanopticMap, truth: SurfaceTruth) -> tuple[dict[str, Any], Comparison]:
    """Surface, instances and answers of one map, under unified categories; and what pictures are drawn of."""
    # Without voxels: the two errors of Panoptic Multi-TSDFs are in no study.
    reconstruction = replace(map_reconstruction(panoptic_map, "map"), layers=())
    comparison = map_evaluation.compare(unified(reconstruction), truth)
    evaluation = map_evaluation.measure(comparison)
    matches = evaluation.instances.matches if evaluation.instances else ()
    answers = language_metrics(name_outcomes(panoptic_map, matches, truth))
    flat = {key: value for key, value in evaluation.to_dict().items() if key not in PROGRAM_ONLY}
    return flat | asdict(answers), comparison


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
