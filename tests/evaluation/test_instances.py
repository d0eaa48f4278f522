from __future__ import annotations

from pathlib import Path

import pytest

from tests.evaluation.scenes import grid, mesh_of, square, write_truth
from uppm.core.errors import InputError
from uppm.core.types import Mesh
from uppm.evaluation.geometry import nearest_points
from uppm.evaluation.ground_truth import SurfaceTruth, load_surface_truth
from uppm.evaluation.instances import InstanceMetrics, main_instances
from uppm.evaluation.map_evaluation import Reconstruction, evaluate_map
from uppm.evaluation.sampling import SurfacePart, sample_parts


@pytest.fixture
def truth(tmp_path: Path) -> SurfaceTruth:
    """Floor 1, mug 2, sofa 3 and the coin 4, which is too small to count."""
    return load_surface_truth(
        write_truth(
            tmp_path,
            {
                1: grid(0, 0, 0),
                2: grid(2, 0, 1, side=0.2),
                3: grid(0, 2, 1),
                4: grid(3, 3, 1, side=0.02),
            },
        )
    )


FLOOR = SurfacePart(id=1, mesh=square(0, 0, 0), category="floor-wood")
MUG = SurfacePart(id=2, mesh=square(2, 0, 1, side=0.2), category="cup", is_object=True)
SOFA = SurfacePart(id=3, mesh=square(0, 2, 1), category="couch", is_object=True)


def measured(truth: SurfaceTruth, *parts: SurfacePart) -> InstanceMetrics:
    found = evaluate_map(Reconstruction(source="map", parts=tuple(parts)), truth).instances
    assert found is not None
    return found


def halves(part: SurfacePart, category: str) -> tuple[SurfacePart, SurfacePart]:
    """The part's two triangles as two submaps."""
    mesh: Mesh = part.mesh
    first, second = (mesh_of(mesh.vertices, mesh.faces[i : i + 1]) for i in (0, 1))
    return (
        SurfacePart(id=part.id, mesh=first, category=part.category, is_object=part.is_object),
        SurfacePart(id=part.id + 100, mesh=second, category=category, is_object=part.is_object),
    )


def test_one_submap_each(truth: SurfaceTruth) -> None:
    found = measured(truth, FLOOR, MUG, SOFA)
    assert (found.instances, found.things) == (3, 2)
    assert found.one_submap_ratio == found.one_submap_ratio_things == found.category_accuracy == 1
    assert found.fragmentation == found.object_count_ratio == found.mean_coverage == 1
    assert (found.missed_instances, found.unmatched_submaps, found.things_found) == (0, 0, 2)


def test_a_sofa_in_two_submaps(truth: SurfaceTruth) -> None:
    found = measured(truth, FLOOR, MUG, *halves(SOFA, "bed"))
    assert found.one_submap_ratio == pytest.approx(2 / 3)
    assert found.one_submap_ratio_things == pytest.approx(1 / 2)
    assert found.fragmentation == pytest.approx(4 / 3)
    assert found.fragmentation_things == found.object_count_ratio == pytest.approx(3 / 2)
    assert found.category_accuracy == pytest.approx(3 / 4)
    assert found.matches[2].submaps == (3, 103)
    assert found.matches[2].right_category == (3,)
    assert found.matches[2].coverage == 1
    assert found.things_found == 2


def test_a_missed_mug_and_an_invented_thing(truth: SurfaceTruth) -> None:
    ghost = SurfacePart(id=7, mesh=square(1.5, 1.5, 2), category="cat", is_object=True)
    found = measured(truth, FLOOR, SOFA, ghost)
    assert found.one_submap_ratio == pytest.approx(2 / 3)
    assert (found.missed_instances, found.unmatched_submaps, found.things_found) == (1, 1, 1)
    assert found.object_count_ratio == 1
    assert found.mean_coverage == pytest.approx(2 / 3)


def test_a_submap_over_two_instances_belongs_to_the_larger(truth: SurfaceTruth) -> None:
    vertices, faces = SOFA.mesh.vertices, SOFA.mesh.faces
    both = mesh_of([*vertices, *MUG.mesh.vertices], [*faces, *(MUG.mesh.faces + 4)])
    found = measured(truth, FLOOR, SurfacePart(id=5, mesh=both, category="chair", is_object=True))
    assert [m.submaps for m in found.matches] == [(1,), (), (5,)]
    assert found.category_accuracy == 1


def test_half_a_submap_on_an_instance_does_not_make_it_its_own(truth: SurfaceTruth) -> None:
    off = SurfacePart(id=5, mesh=square(0.5, 2, 1), category="couch", is_object=True)
    samples = sample_parts([off], 10_000)
    on_it = main_instances(samples, nearest_points(samples.points, truth.index), truth)
    assert on_it == {5: 3}  # half of it, and the strip of 5 cm beside
    further = sample_parts([SurfacePart(id=5, mesh=square(0.6, 2, 1))], 10_000)
    assert main_instances(further, nearest_points(further.points, truth.index), truth) == {5: 0}


def test_pixels_decide_what_is_visible(truth: SurfaceTruth) -> None:
    found = evaluate_map(
        Reconstruction(
            source="map",
            parts=(
                FLOOR,
                MUG,
                SOFA,
            ),
        ),
        truth,
        min_pixels=1,
    ).instances
    assert found is not None
    assert (found.instances, found.missed_instances) == (4, 1)
    nothing = evaluate_map(Reconstruction(source="map", parts=(FLOOR,)), truth, min_pixels=10**6).instances
    assert nothing is not None
    assert nothing.instances == 0
    assert nothing.one_submap_ratio is None


def test_a_bare_mesh_has_no_instances(truth: SurfaceTruth) -> None:
    found = evaluate_map(Reconstruction(source="mesh.ply", parts=(SurfacePart(id=1, mesh=square(0, 0, 0)),)), truth)
    assert found.instances is None
    assert "accuracy_cm" in found.to_dict()


def test_ids_start_at_one(truth: SurfaceTruth) -> None:
    with pytest.raises(InputError, match="submap ids: expected 1 or more"):
        evaluate_map(
            Reconstruction(source="map", parts=(SurfacePart(id=0, mesh=square(0, 0, 0), category="cup"),)), truth
        )
