"""`uppm check`: exit status, text and JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from tests.datasets import scene
from uppm.cli.check import check
from uppm.core.errors import BadFrameError
from uppm.core.geometry import invert

app = typer.Typer()
app.command()(check)


def run(*arguments: str):
    return CliRunner().invoke(app, list(arguments))


def test_right_sequence(tmp_path: Path) -> None:
    result = run(str(scene.write_frames(tmp_path / "room")))
    assert result.exit_code == 0
    assert "room: frames, 16 frames, 16 read" in result.output
    assert "Nothing looks wrong." in result.output


def test_inverted_poses(tmp_path: Path) -> None:
    root = str(scene.write_frames(tmp_path / "room", stored=lambda i, T: invert(T)))
    result = run(root)
    assert result.exit_code == 1
    assert "poses look inverted: agreement" in result.output
    assert "use --invert-poses" in result.output
    assert run(root, "--invert-poses").exit_code == 0


def test_json(tmp_path: Path) -> None:
    root = scene.write_frames(tmp_path / "room", units=5000)
    result = run(str(root), "--json", "--quick")
    data = json.loads(result.output)
    assert result.exit_code == 1
    assert data["format"] == "frames"
    assert not data["ok"]
    assert [(finding["kind"], finding["fix"]) for finding in data["findings"]] == [
        ("depth-scale", "use --depth-scale 5000")
    ]
    assert json.loads(run(str(root), "--json", "--depth-scale", "5000").output)["ok"]


def test_strict_ends_at_a_bad_frame(tmp_path: Path) -> None:
    root = scene.write_frames(tmp_path / "room")
    (root / "pose/00004.txt").unlink()
    assert run(str(root)).exit_code == 1
    result = run(str(root), "--strict")
    assert isinstance(result.exception, BadFrameError)


@pytest.mark.parametrize("option", [("--format", "kitti"), ("--pose-axes", "ros"), ("--depth-scale", "0")])
def test_wrong_options(tmp_path: Path, option: tuple[str, str]) -> None:
    from uppm.core.errors import ConfigError

    result = run(str(scene.write_frames(tmp_path / "room", count=1)), *option)
    assert isinstance(result.exception, ConfigError)
