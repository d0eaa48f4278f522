"""The commands of the user's guide, as its pages show them."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "guide"
PAGES = sorted(path.name for path in GUIDE.glob("*.md"))


@dataclass(frozen=True)
class Shown:
    """One console block: what is typed, and the lines that it printed."""

    arguments: list[str]
    """Behind `uppm`."""
    output: list[str]

    @property
    def whole(self) -> bool:
        """Nothing of the output was left out."""
        return not any(line.strip() == "..." for line in self.output)


def blocks(page: str) -> list[Shown]:
    """The console blocks of a page, in order."""
    text = (GUIDE / page).read_text(encoding="utf-8")
    found = []
    for block in re.findall(r"^```console\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        first, *output = block.splitlines()
        assert first.startswith("$ uppm "), first
        found.append(Shown(shlex.split(first.removeprefix("$ uppm ")), output))
    return found


def python(page: str) -> list[str]:
    """The Python blocks of a page that follow its commands."""
    text = (GUIDE / page).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
