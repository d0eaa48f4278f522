"""docs/configuration.md and docs/cli.md against the program."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
import typer
from pydantic import BaseModel

from uppm.cli.main import app
from uppm.core.config import Config

DOCS = Path(__file__).resolve().parents[2] / "docs"


def settings() -> Iterator[tuple[str, object]]:
    """Name and default of every setting."""
    yield from settings_of(Config(), "")


def settings_of(section: BaseModel, path: str) -> Iterator[tuple[str, object]]:
    for name, value in section:
        if isinstance(value, BaseModel):
            yield from settings_of(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


def shown(value: object) -> str:
    if value is None or isinstance(value, bool):
        return str(value).lower()
    return f"{value:.10g}" if isinstance(value, int | float) else str(value)


def commands(group: click.Group, path: str = "uppm") -> Iterator[tuple[str, click.Command]]:
    """Every command that does something, by its full name."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{path} {name}")  # pyright: ignore[reportArgumentType]
        else:
            yield f"{path} {name}", command


COMMANDS = dict(commands(typer.main.get_command(app)))  # pyright: ignore[reportArgumentType]


def test_every_setting_is_documented_with_its_default() -> None:
    text = (DOCS / "configuration.md").read_text(encoding="utf-8")
    documented = dict(re.findall(r"^\| `([a-z]+(?:\.[a-z_0-9]+)+)` \| ([^|]*?) \|", text, re.MULTILINE))
    assert documented == {name: shown(value) for name, value in settings()}


def test_options_named_beside_settings_exist() -> None:
    text = (DOCS / "configuration.md").read_text(encoding="utf-8")
    named = re.findall(r"^\| `[a-z]+\.[a-z_0-9]+` \|[^|]*\|[^|]*\| `(--[a-z-]+)` \|", text, re.MULTILINE)
    assert len(named) > 10
    assert set(named) <= {option for p in COMMANDS["uppm map"].params for option in p.opts}


def test_every_command_is_documented() -> None:
    text = (DOCS / "cli.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## `(uppm [a-z -]+?)(?: [^a-z`][^`]*)?`$", text, re.MULTILINE)
    assert sorted(headings) == sorted(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_documented_with_an_example(name: str) -> None:
    sections = (DOCS / "cli.md").read_text(encoding="utf-8").split("\n## ")
    section = next(s for s in sections if re.match(rf"`{name}\b", s))
    first_cells = " ".join(re.findall(r"^\| (`-[^|]*) \|", section, re.MULTILINE))
    documented = set(re.findall(r"`(-[-a-z0-9]+)`", first_cells))
    options = [o for p in COMMANDS[name].params if p.param_type_name == "option" for o in (*p.opts, *p.secondary_opts)]
    assert documented == set(options) - {"--help"}
    assert re.search(rf"^    {name}\b", section, re.MULTILINE)


def lines_of(document: str) -> Iterator[str]:
    """Commands in the document's blocks, without comments; patterns such as `MAP|MESH` are left out."""
    text = (DOCS / document).read_text(encoding="utf-8")
    for line in re.findall(r"^(?: {4})?(uppm [a-z][^\n]*)$", text, re.MULTILINE):
        if not re.search(r"\.\.\.|MAP\|", line):
            yield line.split(" #")[0]


@pytest.mark.parametrize("document", ["results.md", "evaluation.md"])
def test_commands_that_documents_show_are_understood(document: str) -> None:
    shown = list(lines_of(document))
    assert len(shown) >= 3
    for line in shown:
        words = shlex.split(line)
        name = max((n for n in COMMANDS if f"{line} ".startswith(f"{n} ")), key=len)
        COMMANDS[name].make_context(name, words[len(name.split()) :])
