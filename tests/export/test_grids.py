"""Grids as other programs read them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from uppm.core.errors import InputError
from uppm.export.grids import write_arrays, write_costs, write_plan

PLAN = np.array([[-1, 0, 1], [0, 0, 1]], dtype=np.int8)


def test_a_plan_is_read_as_map_server_reads_it(tmp_path: Path) -> None:
    """The rules of ROS's map_server in `trinary` mode: p = (255 - grey) / 255, against the two thresholds."""
    yaml_file, image_file = write_plan(tmp_path / "plan.yaml", PLAN, resolution=0.05, origin=(-1.5, 2.25))
    meta = yaml.safe_load(yaml_file.read_text())
    assert (meta["resolution"], meta["origin"], meta["negate"], meta["mode"]) == (0.05, [-1.5, 2.25, 0], 0, "trinary")
    grey = cv2.imread(str(yaml_file.parent / meta["image"]), cv2.IMREAD_UNCHANGED)
    assert grey is not None
    assert image_file.name == "plan.pgm"
    p = (255 - grey[::-1].T.astype(float)) / 255
    read = np.where(p > meta["occupied_thresh"], 1, np.where(p < meta["free_thresh"], 0, -1))
    np.testing.assert_array_equal(read, PLAN)


def test_costs_are_written_as_they_are(tmp_path: Path) -> None:
    costs = np.array([[0, 50, 100], [255, 1, 99]], dtype=np.uint8)
    yaml_file, image_file = write_costs(tmp_path / "cost.yml", costs, resolution=0.1, origin=(0, 0))
    assert yaml.safe_load(yaml_file.read_text())["mode"] == "raw"
    grey = cv2.imread(str(image_file), cv2.IMREAD_UNCHANGED)
    assert grey is not None
    np.testing.assert_array_equal(grey[::-1].T, costs)


def test_arrays_come_back(tmp_path: Path) -> None:
    write_arrays(tmp_path / "a.npz", {"plan": PLAN, "resolution": 0.05})
    with np.load(tmp_path / "a.npz") as found:
        np.testing.assert_array_equal(found["plan"], PLAN)
        assert found["resolution"] == 0.05


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"plan\.png: expected a name ending in \.yaml, found '\.png'"):
        write_plan(tmp_path / "plan.png", PLAN, resolution=0.05, origin=(0, 0))
    with pytest.raises(InputError, match=r"expected a name ending in \.npz"):
        write_arrays(tmp_path / "a.txt", {})
    assert not list(tmp_path.iterdir())
