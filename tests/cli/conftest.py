"""The program as a user runs it, but in this process, and a room to run it on."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.cli.room import write_room
from uppm.cli.main import main


@dataclass(frozen=True)
class Done:
    code: int
    out: str
    err: str


Uppm = Callable[..., Done]


@pytest.fixture
def uppm(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Uppm:
    """Runs `uppm` with arguments through its entry point; what native code prints is captured too."""

    def run(*arguments: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["uppm", *map(str, arguments)])
        capfd.readouterr()
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0
        out, err = capfd.readouterr()
        return Done(code=code, out=out, err=err)

    return run


@pytest.fixture(scope="session")
def whole_room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Read only: a test that breaks it takes `room`."""
    return write_room(tmp_path_factory.mktemp("whole") / "room")


@pytest.fixture
def room(whole_room: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole_room, tmp_path / "room"))


@pytest.fixture(scope="session")
def map_file(whole_room: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The room mapped with its instances known; read only."""
    from uppm.core.config import Config
    from uppm.pipeline import map_sequence, open_sequence

    path = tmp_path_factory.mktemp("maps") / "room.uppm"
    map_sequence(open_sequence(whole_room), path, Config.load(None, ["perception.profile=groundtruth"]))
    return path
