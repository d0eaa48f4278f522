from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.conftest import shared_data
from tests.evaluation.scenes import LABELS, grid, write_truth
from uppm.core.errors import InputError
from uppm.evaluation.ground_truth import load_surface_truth


def test_reads_points_in_metres_with_their_instances(tmp_path: Path) -> None:
    truth = load_surface_truth(write_truth(tmp_path, {1: grid(0, 0, 0), 2: grid(0, 0, 0.5, side=0.1)}))
    assert truth.points[:, 2].max() == 0.5
    assert truth.instances[3].categories == ("couch", "chair")
    assert truth.foreground.sum() == 100
    assert (truth.instance[truth.foreground] == 2).all()


def test_reads_the_rendered_flat() -> None:
    truth = load_surface_truth(shared_data("data/flat/run1"))
    assert truth.points.shape == (2536960, 3)
    assert truth.instances[21].name == "sofa"
    assert not truth.instances[3].is_thing


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (LABELS.replace("categories", "classes"), r"labels\.csv: expected columns .* found no column 'categories'"),
        (LABELS.replace("couch", "settee"), r"labels\.csv, line 4: expected unified categories, found 'settee'"),
        (LABELS.replace("couch|chair", ""), r"labels\.csv, line 4: expected unified categories, found none"),
        (LABELS.replace("5000", "many"), r"labels\.csv, line 3: expected whole numbers, found .*'many'"),
        (LABELS.replace("2,mug,1,cup,5000,\n", ""), r"found surface points of instance 2, which it lacks"),
    ],
)
def test_bad_labels(tmp_path: Path, labels: str, message: str) -> None:
    write_truth(tmp_path, {1: grid(0, 0, 0), 2: grid(0, 0, 0.5)}, labels)
    with pytest.raises(InputError, match=message):
        load_surface_truth(tmp_path)


def test_missing_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a folder, found no such folder"):
        load_surface_truth(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"expected ground truth: surface\.npz .* found none of these"):
        load_surface_truth(tmp_path)
    write_truth(tmp_path, {1: grid(0, 0, 0)})
    (tmp_path / "labels.csv").unlink()
    with pytest.raises(InputError, match=r"labels\.csv: expected a table of instances, found no such file"):
        load_surface_truth(tmp_path)


def damage(file: Path, kind: str) -> None:
    if kind == "truncated":
        file.write_bytes(file.read_bytes()[:-40])
    elif kind == "empty file":
        file.write_bytes(b"")
    elif kind == "pickled":
        np.savez(file, xyz_mm=np.array([{}], dtype=object), instance=np.zeros(1, np.uint16))
    elif kind == "no instance":
        np.savez(file, xyz_mm=np.zeros((5, 3), np.int16))
    elif kind == "lengths":
        np.savez(file, xyz_mm=np.zeros((5, 3), np.int16), instance=np.zeros(4, np.uint16))
    elif kind == "no points":
        np.savez(file, xyz_mm=np.zeros((0, 3), np.int16), instance=np.zeros(0, np.uint16))
    else:
        np.savez(file, xyz_mm=np.zeros((5, 3)), instance=np.zeros(5, np.uint16))


@pytest.mark.parametrize(
    "kind", ["truncated", "empty file", "pickled", "no instance", "lengths", "no points", "floating point"]
)
def test_bad_surfaces(tmp_path: Path, kind: str) -> None:
    damage(write_truth(tmp_path, {1: grid(0, 0, 0)}) / "surface.npz", kind)
    with pytest.raises(InputError, match=r"surface\.npz: expected arrays xyz_mm .* found \S+.*; ") as caught:
        load_surface_truth(tmp_path)
    assert "\n" not in str(caught.value)
