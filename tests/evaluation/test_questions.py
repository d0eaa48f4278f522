"""Sixty questions about the rendered flat, answered from its ground truth by hand; 15 were held out in tuning."""

from __future__ import annotations

import csv
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import KDTree

from tests.conftest import shared_data
from uppm.evaluation.ground_truth import load_surface_truth
from uppm.map.panoptic_map import PanopticMap
from uppm.perception.labels.lemma import lemmatize
from uppm.pipeline import Config, map_sequence, open_map, open_sequence

QUESTIONS = Path(__file__).parent / "data" / "questions_flat.tsv"


@dataclass(frozen=True, kw_only=True)
class Asked:
    """A row of the table."""

    held_out: bool
    text: str
    ids: frozenset[int]
    """Instances that are the answer; those that the map lacks are not asked for."""
    count: int | None
    viewpoint: npt.NDArray[np.float64] | None


def read_questions() -> list[Asked]:
    with QUESTIONS.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    return [
        Asked(
            held_out=row["set"] == "held out",
            text=row["question"],
            ids=frozenset() if row["answer"].startswith("#") else frozenset(map(int, row["answer"].split(","))),
            count=int(row["answer"][1:]) if row["answer"].startswith("#") else None,
            viewpoint=np.array(row["viewpoint"].split(), dtype=np.float64) if row["viewpoint"] else None,
        )
        for row in rows
    ]


def instances_of(panoptic: PanopticMap, sequence: Path) -> dict[int, int]:
    """Submap -> of the instances that are called as it is, the one that most of its surface is nearest to."""
    truth = load_surface_truth(sequence)
    found = {}
    for submap in panoptic.submaps:
        points = panoptic.submap_mesh(submap.id).vertices
        if submap.descriptor and len(points):
            label = lemmatize(submap.descriptor.labels[0].text)
            ids = [i.id for i in truth.instances.values() if lemmatize(i.name) == label]
            own = np.isin(truth.instance, ids)
            near = KDTree(truth.points[own]).query(points[:: max(1, len(points) // 300)])[1]
            found[submap.id] = Counter(truth.instance[own][near].tolist()).most_common(1)[0][0]
    return found


def is_right(panoptic: PanopticMap, asked: Asked, instance: dict[int, int]) -> bool:
    reply = panoptic.ask(asked.text, limit=100, viewpoint=asked.viewpoint)
    if reply.plain:
        return False
    if asked.count is not None:
        return reply.counting and reply.count == asked.count
    return {instance[f.submap.id] for f in reply.results} == asked.ids & set(instance.values())


@pytest.mark.heavy
def test_questions_on_the_flat(tmp_path: Path) -> None:
    sequence = shared_data("data/flat/run1")
    config = Config.model_validate({"perception": {"profile": "groundtruth"}})
    map_sequence(open_sequence(sequence), tmp_path / "gts.uppm", config)
    panoptic = open_map(tmp_path / "gts.uppm")
    instance = instances_of(panoptic, sequence)
    assert set(panoptic.rooms.values()) == {"living room", "kitchen", "office", "bedroom"}
    asked = read_questions()
    assert len(asked) == 60
    right = {a.text: is_right(panoptic, a, instance) for a in asked}
    wrong = [text for text, good in right.items() if not good]
    assert sum(right.values()) >= 54, wrong
    assert sum(right[a.text] for a in asked if a.held_out) >= 13, wrong
