"""Panoptic quality, mean IoU and AUROC beside other people's implementations (extra `dev`)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from uppm.evaluation.language import auroc
from uppm.evaluation.overlaps import Overlaps, PredictedSegment, TrueSegment, overlaps
from uppm.evaluation.panoptic import count_matches, panoptic_quality
from uppm.evaluation.semantic import semantic_quality

Ids = npt.NDArray[np.int64]
CLASSES = {1: ("cup", True), 2: ("chair", True), 3: ("floor-wood", False), 4: ("wall-wood", False)}


def random_image(random: np.random.Generator, size: int = 24) -> tuple[Ids, dict[int, int], Ids, dict[int, int]]:
    """Id images of truth (with void) and prediction, and the class of each id; stuff is one segment a class."""
    cells = random.integers(0, 8, (size // 4, size // 4))
    truth = np.kron(cells, np.ones((4, 4), dtype=np.int64))
    classes = {i: int(random.integers(1, 3)) for i in range(1, 6)} | {6: 3, 7: 4}
    moved = np.roll(truth, (int(random.integers(2)), int(random.integers(2))), axis=(0, 1))
    predicted = np.where(random.random(truth.shape) < 0.1, random.integers(0, 8, truth.shape), moved)
    said = {i: c if random.random() < 0.8 else 3 - c for i, c in classes.items() if c < 3} | {6: 3, 7: 4}
    return truth, classes, predicted, said


def ours(images: list[tuple[Ids, dict[int, int], Ids, dict[int, int]]]) -> list[Overlaps]:
    return [
        overlaps(
            truth,
            predicted,
            {i: TrueSegment(classes=(CLASSES[c][0],), is_thing=CLASSES[c][1]) for i, c in classes.items()},
            {i: PredictedSegment(name=CLASSES[c][0]) for i, c in said.items()},
        )
        for truth, classes, predicted, said in images
    ]


def write_coco(folder: Path, name: str, images: list[tuple[Ids, dict[int, int]]]) -> Path:
    """COCO's panoptic format: a JSON file and a folder of PNG files whose colours are segment ids."""
    (folder / name).mkdir()
    annotations = []
    for number, (ids, classes) in enumerate(images):
        # OpenCV writes BGR; the id is in R.
        cv2.imwrite(str(folder / name / f"{number}.png"), np.stack([0 * ids, 0 * ids, ids], axis=2).astype(np.uint8))
        present = [int(i) for i in np.unique(ids) if i]
        segments: list[dict[str, Any]] = [
            {"id": i, "category_id": classes[i], "iscrowd": 0, "area": int((ids == i).sum())} for i in present
        ]
        annotations.append({"image_id": number, "file_name": f"{number}.png", "segments_info": segments})
    height, width = images[0][0].shape
    listed = [{"id": n, "file_name": f"{n}.jpg", "height": height, "width": width} for n in range(len(images))]
    categories = [{"id": i, "name": n, "isthing": int(thing)} for i, (n, thing) in CLASSES.items()]
    file = folder / f"{name}.json"
    file.write_text(json.dumps({"images": listed, "annotations": annotations, "categories": categories}))
    return file


@pytest.mark.parametrize("seed", range(4))
def test_panoptic_quality_as_coco_has_it(tmp_path: Path, seed: int) -> None:
    panoptic = pytest.importorskip("hotcoco.panoptic", reason="needs `pip install hotcoco` (extra dev)")
    random = np.random.default_rng(seed)
    images = [random_image(random) for _ in range(3)]
    truth = write_coco(tmp_path, "truth", [(t, c) for t, c, _, _ in images])
    predicted = write_coco(tmp_path, "predicted", [(p, s) for _, _, p, s in images])
    theirs = panoptic.pq_compute(str(truth), str(predicted))
    found = panoptic_quality([count_matches(table) for table in ours(images)])
    assert 0.1 < theirs["All"]["pq"] < 0.9
    for means, group in ((found.all, "All"), (found.things, "Things"), (found.stuff, "Stuff")):
        assert (means.pq, means.sq, means.rq) == pytest.approx(tuple(theirs[group][k] for k in ("pq", "sq", "rq")))
    for number, (name, _) in CLASSES.items():
        one, other = found.per_class[name], theirs["per_class"][number]
        assert (one.tp, one.fp, one.fn) == (other["tp"], other["fp"], other["fn"])
        assert (one.pq, one.sq, one.rq) == pytest.approx((other["pq"], other["sq"], other["rq"]))


@pytest.mark.parametrize("seed", range(4))
def test_mean_iou_by_a_confusion_matrix(seed: int) -> None:
    metrics = pytest.importorskip("sklearn.metrics", reason="needs `pip install scikit-learn` (extra dev)")
    random = np.random.default_rng(seed)
    images = [random_image(random) for _ in range(3)]
    true, said = [], []
    for truth, classes, predicted, names in images:
        known = truth > 0
        true.append(np.array([0, *(classes[i] for i in range(1, 8))])[truth[known]])
        said.append(np.array([0, *(names[i] for i in range(1, 8))])[predicted[known]])
    true, said = np.concatenate(true), np.concatenate(said)
    found = semantic_quality(ours(images))
    present = np.unique(true)
    assert found.miou == pytest.approx(metrics.jaccard_score(true, said, labels=present, average="macro"))
    assert found.fw_iou == pytest.approx(metrics.jaccard_score(true, said, labels=present, average="weighted"))


@pytest.mark.parametrize("seed", range(5))
def test_auroc_with_ties(seed: int) -> None:
    metrics = pytest.importorskip("sklearn.metrics", reason="needs `pip install scikit-learn` (extra dev)")
    random = np.random.default_rng(seed)
    scores, positive = random.integers(0, 6, 40) / 5, random.random(40) < 0.4
    assert auroc(scores, positive) == pytest.approx(metrics.roc_auc_score(positive, scores))
