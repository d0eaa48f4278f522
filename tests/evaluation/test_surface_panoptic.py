"""Panoptic quality on points, beside sets of points written down once more."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from tests.evaluation.scenes import grid, square, write_truth
from uppm.evaluation.ground_truth import SurfaceTruth, load_surface_truth
from uppm.evaluation.map_evaluation import Reconstruction, evaluate_map
from uppm.evaluation.sampling import SurfacePart, sample_parts

DENSITY = 900.0


@pytest.fixture
def truth(tmp_path: Path) -> SurfaceTruth:
    """Floor 1, mug 2, sofa 3."""
    step = 0.04
    surfaces = {1: grid(0, 0, 0, step=step), 2: grid(2, 0, 1, side=0.4, step=step), 3: grid(0, 2, 1, step=step)}
    return load_surface_truth(write_truth(tmp_path, surfaces))


FLOOR = SurfacePart(id=1, mesh=square(0, 0, 0), category="floor-wood")
MUG = SurfacePart(id=2, mesh=square(2.08, 0, 1, side=0.4), category="cup", is_object=True)
SOFA = SurfacePart(id=3, mesh=square(0, 2.3, 1), category="chair", is_object=True)
GHOST = SurfacePart(id=4, mesh=square(2, 2, 2, side=0.5), category="cat", is_object=True)
BED = SurfacePart(id=5, mesh=square(0, 2, 1, side=0.3), category="bed", is_object=True)


def by_sets(parts: list[SurfacePart], truth: SurfaceTruth) -> dict[str, tuple[int, int, int, float]]:
    """Class -> TP, FP, FN and the sum of IoU, by sets of element names; no class here is in two segments."""
    samples = sample_parts(parts, DENSITY)
    matrix = cdist(samples.points, truth.points)
    predicted, true = defaultdict[int, set[str]](set), defaultdict[int, set[str]](set)
    for g, instance in enumerate(truth.instance.tolist()):
        true[instance].add(f"g{g}")
        if matrix[:, g].min() <= 0.05:
            predicted[int(samples.part[matrix[:, g].argmin()])].add(f"g{g}")
    for r, part in enumerate(samples.part.tolist()):
        if matrix[r].min() > 0.05:
            predicted[part].add(f"r{r}")
    category = {part.id: str(part.category) for part in parts}
    counts: dict[str, list[float]] = defaultdict(lambda: [0, 0, 0, 0.0])
    matched: set[int] = set()
    for instance, elements in true.items():
        right = truth.instances[instance].categories
        ious = {p: len(e & elements) / len(e | elements) for p, e in predicted.items() if category[p] in right}
        best = max(ious, key=ious.__getitem__, default=None)
        if best is not None and ious[best] > 0.5:
            matched.add(best)
            counts[right[0]][0] += 1
            counts[right[0]][3] += ious[best]
        else:
            counts[right[0]][2] += 1
    for p in predicted.keys() - matched:
        # None of the false ones here is called as stuff, whose classes would be merged into one.
        counts[category[p]][1] += 1
    return {name: (int(tp), int(fp), int(fn), iou) for name, (tp, fp, fn, iou) in counts.items()}


@pytest.mark.parametrize(
    "parts",
    [[FLOOR, MUG, SOFA], [FLOOR, MUG, SOFA, GHOST, BED], [FLOOR, GHOST], [MUG, BED]],
    ids=["moved", "moved, a ghost and a bed", "things missed", "floor missed"],
)
def test_quality_on_points_as_by_sets(parts: list[SurfacePart], truth: SurfaceTruth) -> None:
    found = evaluate_map(Reconstruction(source="map", parts=tuple(parts)), truth, points_per_m2=DENSITY).panoptic
    assert found is not None
    expected = by_sets(parts, truth)
    assert set(found.per_class) == set(expected)
    for name, (tp, fp, fn, iou) in expected.items():
        counts = found.per_class[name]
        assert (counts.tp, counts.fp, counts.fn) == (tp, fp, fn), name
        assert counts.iou == pytest.approx(iou)
    rq = [tp / (tp + fp / 2 + fn / 2) for tp, fp, fn, _ in expected.values()]
    sq = [iou / tp if tp else 0.0 for tp, _, _, iou in expected.values()]
    assert found.rq == pytest.approx(np.mean(rq))
    assert found.sq == pytest.approx(np.mean(sq))
    assert found.pq == pytest.approx(np.mean(np.array(rq) * sq))


def test_by_hand(truth: SurfaceTruth) -> None:
    half = SurfacePart(id=3, mesh=square(0, 2, 1, side=0.6), category="couch", is_object=True)
    found = evaluate_map(Reconstruction(source="map", parts=(FLOOR, half)), truth).panoptic
    assert found is not None
    # 0.6 m and the strip of 5 cm: 16 of the 25 rows and columns of points, 0.41 of the sofa: a miss and a false one.
    assert [(c.tp, c.fp, c.fn) for c in found.per_class.values()] == [(0, 1, 1), (0, 0, 1), (1, 0, 0)]
    assert list(found.per_class) == ["couch", "cup", "floor-other"]
    assert (found.pq, found.pq_things, found.pq_stuff) == pytest.approx((1 / 3, 0, 1))
    assert (found.map_30, found.map_40, found.map_50) == pytest.approx((0.5, 0.5, 0))
    assert found.miou == pytest.approx((1 + 0 + 16**2 / 25**2) / 3)
    assert found.fw_iou == pytest.approx((625 + 16**2) / (625 + 100 + 625))
