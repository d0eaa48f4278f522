"""`uppm demo`, whole: what it finds, answers and writes."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib import resources
from pathlib import Path

import cv2
import pytest
import trimesh

from tests.cli.conftest import Uppm
from uppm.cli.demo import PROMPTS

DEMO = resources.files("uppm.data").joinpath("demo")


@pytest.mark.heavy
def test_demo(tmp_path: Path, uppm: Uppm) -> None:
    command = [sys.executable, "-m", "uppm.cli.main", "demo", "-o", "a/b"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")

    out = tmp_path / "a/b"
    names = {"demo.uppm", "mesh.glb", "scene.json", "top_down.png", "view.png", "instances.png"}
    assert {p.name for p in out.iterdir()} == names
    assert all(p.stat().st_size > 10_000 for p in out.iterdir())
    assert all(f"a/b/{name}\n" in done.stdout for name in names)
    for picture in out.glob("*.png"):
        pixels = cv2.imread(str(picture))
        assert pixels is not None
        assert pixels.std() > 20
    assert len(trimesh.load_scene(out / "mesh.glb").geometry) > 12
    assert max(map(len, done.stdout.splitlines())) <= 80

    assert len(PROMPTS) == 6
    assert [p for p in PROMPTS if f"{p!r}: nothing here matches" in done.stdout] == ["bicycle"]
    for prompt in PROMPTS:
        answer = json.loads(uppm("query", out / "demo.uppm", prompt, "--json").out)
        assert answer["found"] == (prompt != "bicycle")

    options = ("--ground-truth", DEMO, "--min-pixels", "500", "--points-per-m2", "2000", "--json")
    found = json.loads(uppm("evaluate", "map", out / "demo.uppm", *options).out)
    assert found["things_found"] >= 12
    assert found["completion_ratio_5cm"] > 0.8
