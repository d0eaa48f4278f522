"""Ground truth of other data sets, on small scans written to their formats."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.evaluation import scans
from uppm.core.categories import category_by_name
from uppm.core.errors import InputError
from uppm.evaluation.ground_truth import load_instances, load_surface_truth
from uppm.evaluation.truth.class_maps import class_map, classify


@pytest.fixture(autouse=True)
def _plyfile() -> None:
    pytest.importorskip("plyfile", reason="needs `pip install uppm[eval]`")


@pytest.mark.parametrize(
    ("write", "floor", "table", "name"),
    [
        (scans.scannet, 1, 2, "coffee table"),
        (scans.three_rscan, 1, 12, "couch table"),
        (scans.replica, 1, 22, "table"),
    ],
)
def test_annotated_meshes(tmp_path: Path, write: Callable[[Path], Path], floor: int, table: int, name: str) -> None:
    truth = load_surface_truth(write(tmp_path))
    # 10,000 points a square metre: 4 m2 of floor, a quarter of table.
    assert {int(i): int(n) for i, n in zip(*np.unique(truth.instance, return_counts=True), strict=True)} == {
        floor: pytest.approx(40_000, rel=0.01),
        table: pytest.approx(2500, rel=0.1),
    }
    on_table = truth.points[truth.instance == table]
    assert on_table[:, 2] == pytest.approx(0.4, abs=1e-6)
    assert on_table[:, :2].min() >= 0.5
    assert on_table[:, :2].max() <= 1
    assert truth.instances[table].name == name
    assert truth.instances[table].is_thing
    assert "table" in truth.instances[table].categories
    assert not truth.instances[floor].is_thing
    assert truth.instances[floor].categories[0] == "floor-other"
    assert truth.instances[table].pixels is None
    assert not truth.is_observed
    assert load_instances(Path(truth.source)).keys() == truth.instances.keys()


def test_sampled_alike_a_second_time(tmp_path: Path) -> None:
    scan = scans.replica(tmp_path)
    assert (load_surface_truth(scan).points == load_surface_truth(scan).points).all()


def test_replica_scene_may_be_named_by_its_habitat_folder(tmp_path: Path) -> None:
    scene = scans.replica(tmp_path)
    assert len(load_surface_truth(scene / "habitat").points) == len(load_surface_truth(scene).points)


def test_cloud_of_the_flat(tmp_path: Path) -> None:
    truth = load_surface_truth(scans.panmap_flat(tmp_path))
    assert truth.points.shape == (16, 3)
    assert (truth.instance == 0).all()
    # "Gizmo" has no category.
    assert {n: (i.name, i.is_thing) for n, i in truth.instances.items()} == {
        3: ("Floor", False),
        9: ("Coffee table 2", True),
    }


def test_labels_fall_back_to_nyu40_and_some_have_no_category(tmp_path: Path) -> None:
    desk = load_surface_truth(scans.scannet(tmp_path / "a", label="desk organizer thing"))
    assert desk.instances[2].categories == ("desk-stuff", "table")
    gadget = load_surface_truth(scans.scannet(tmp_path / "b", label="gadget"))
    assert gadget.instances.keys() == {1}
    assert gadget.unmapped == ("gadget",)
    assert (gadget.instance == 0).sum() == pytest.approx(2500, rel=0.1)


def test_a_face_is_of_the_object_that_two_of_its_corners_are_of(tmp_path: Path) -> None:
    scan = scans.scannet(tmp_path)
    file = scan / "scene0000_00_vh_clean_2.0.010000.segs.json"
    content = json.loads(file.read_text())
    content["segIndices"][4] = 77  # one corner of both of the table's triangles, of no object
    file.write_text(json.dumps(content))
    truth = load_surface_truth(scan)
    assert (truth.instance == 2).sum() == pytest.approx(2500, rel=0.1)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda s: (s / "scene0000_00.aggregation.json").unlink(), r"aggregation\.json: .* found no such file"),
        (lambda s: (s / "scene0000_00.aggregation.json").write_text("{}"), r"aggregation\.json: .*segGroups"),
        (lambda s: _drop_a_vertex(s), r"segs\.json: expected those of .*, found 7 numbers for 8 vertices"),
        (lambda s: (s.parents[1] / "scannetv2-labels.combined.tsv").unlink(), r"combined\.tsv: .* found no such file"),
        (lambda s: _cut(s / "scene0000_00_vh_clean_2.ply"), r"_vh_clean_2\.ply: expected a PLY mesh"),
    ],
)
def test_damaged_scannet(tmp_path: Path, spoil: Callable[[Path], object], said: str) -> None:
    scan = scans.scannet(tmp_path)
    spoil(scan)
    with pytest.raises(InputError, match=said) as error:
        load_surface_truth(scan)
    assert "\n" not in str(error.value)


def test_damaged_others(tmp_path: Path) -> None:
    scan = scans.three_rscan(tmp_path / "a")
    with pytest.raises(InputError, match=r"objects\.json: expected objects of the scan other, found none of it"):
        load_surface_truth(scan.rename(scan.with_name("other")))
    scene = scans.replica(tmp_path / "b")
    mesh = scene / "habitat" / "mesh_semantic.ply"
    mesh.write_bytes(mesh.read_bytes().replace(b"object_id", b"object_no"))
    with pytest.raises(InputError, match=r"mesh_semantic\.ply: expected a face property object_id"):
        load_surface_truth(scene)
    run = scans.panmap_flat(tmp_path / "c")
    (tmp_path / "c" / "groundtruth_labels.csv").write_text("A,B\n1,2\n")
    with pytest.raises(InputError, match=r"groundtruth_labels\.csv: expected columns InstanceID"):
        load_surface_truth(run)


def test_a_folder_without_ground_truth(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected ground truth: surface\.npz .*ScanNet.* found none of these"):
        load_surface_truth(tmp_path)


@pytest.mark.parametrize("name", ["nyu40", "scannet", "3rscan", "replica", "panmap_flat"])
def test_class_maps_name_unified_categories(name: str) -> None:
    table = class_map(name)
    assert len(table) >= 39
    unknown = [
        (label, c) for label, meaning in table.items() for c in meaning.categories if c not in category_by_name()
    ]
    assert unknown == []
    assert all(label == label.strip().lower() for label in table)


def test_class_maps_by_hand() -> None:
    assert list(class_map("nyu40"))[:3] == ["wall", "floor", "cabinet"]
    assert list(class_map("nyu40")).index("toilet") + 1 == 33
    for label, tables, coarse, category in (
        ("Office Chair", ("scannet",), "", "chair"),
        ("laptop", (), "", "laptop"),
        ("window", (), "", "window-other"),
        ("sofa", ("3rscan", "scannet"), "", "couch"),
        ("strange lamp", ("scannet",), "lamp", "light"),
    ):
        meaning = classify(label, *tables, coarse=coarse)
        assert meaning is not None
        assert meaning.categories[0] == category
    assert classify("gadget", "scannet", coarse="otherprop") is None


def _drop_a_vertex(scan: Path) -> None:
    file = scan / "scene0000_00_vh_clean_2.0.010000.segs.json"
    file.write_text(json.dumps({"segIndices": [5, 5, 8, 8, 31, 31, 31]}))


def _cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-20])
