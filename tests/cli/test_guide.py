"""Every page of the user's guide, run as written in an empty folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import click
import pytest
import typer

from tests.cli.guide import GUIDE, PAGES, Shown, blocks, python
from uppm.cli.main import app

FLAT = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "flat"
FIXED = {"demo", "check", "convert", "export"}
"""Commands whose output does not depend on the machine: neither on its speed nor on how its networks round."""


@pytest.mark.parametrize("page", PAGES)
def test_every_command_parses(page: str) -> None:
    """Without running any: an option that was renamed or dropped fails here."""
    assert blocks(page)
    for shown in blocks(page):
        command: click.Command = typer.main.get_command(app)  # pyright: ignore[reportAssignmentType]
        rest = list(shown.arguments)
        while hasattr(command, "commands"):
            command = command.commands[rest.pop(0)]  # pyright: ignore[reportAttributeAccessIssue]
        command.make_context(command.name, rest)


def test_every_page_is_named_in_the_index() -> None:
    index = (GUIDE / "README.md").read_text(encoding="utf-8")
    assert [page for page in PAGES if page != "README.md" and f"({page})" not in index] == []


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"COLUMNS": "100"}
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=environment)


def without_percent(line: str) -> str:
    return re.sub(r"\d+%", "%", line)


def check(shown: Shown, done: subprocess.CompletedProcess[str]) -> None:
    """The command ended as the page says, and printed what it says where that is the same everywhere."""
    refused = any(line.startswith("error:") for line in shown.output)
    finding = shown.arguments[0] == "check" and any(line.startswith("  fix:") for line in shown.output)
    assert done.returncode == (2 if refused else int(finding)), done.stderr
    printed = [line.rstrip() for line in (done.stdout + done.stderr).splitlines()]
    if shown.arguments[0] in FIXED:
        wanted = [line for line in shown.output if line.strip() != "..."]
        assert (printed if shown.whole else [line for line in printed if line in wanted]) == wanted
    elif shown.arguments[0] == "query" and shown.whole:
        # Places and probabilities are of the machine; which answer, and how it was understood, are not.
        assert without_percent(printed[0]) == without_percent(shown.output[0])
        assert len(printed) == len(shown.output) + (printed[-1] == "")


@pytest.mark.heavy
@pytest.mark.parametrize("page", PAGES)
def test_every_page_runs_as_written(page: str, tmp_path: Path) -> None:
    if page == "my-bag.md" and not find_spec("rosbags"):
        pytest.skip("pip install uppm[ros] brings rosbags, which this page needs")
    if page == "two-days.md":
        if not FLAT.is_dir():
            pytest.skip(f"the two recordings of this page are development data, {FLAT}")
        for name in ("run1", "run2"):
            (tmp_path / name).symlink_to((FLAT / name).resolve())
    for shown in blocks(page):
        check(shown, run([sys.executable, "-m", "uppm.cli.main", *shown.arguments], tmp_path))
    for code in python(page):
        done = run([sys.executable, "-c", code], tmp_path)
        assert (done.returncode, bool(done.stdout)) == (0, True), done.stderr
