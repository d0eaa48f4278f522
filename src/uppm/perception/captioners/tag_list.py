"""The file of `perception.tag_list`: tags of one's own, with their descriptions."""

from __future__ import annotations

import json
from pathlib import Path

from uppm.core.errors import InputError

ADVICE = "see docs/models.md for the two forms"


def read_descriptions(file: Path) -> dict[str, list[str]]:
    """Tag -> its descriptions, as many for each tag.

    Either a text file, one tag a line, each described as `a photo of a TAG.`; or JSON as RAM++'s authors publish it, a
    list of objects with one tag each and the list of its descriptions.

    Raises
    ------
    InputError
        The file cannot be read, or is of neither form.
    """
    try:
        text = file.read_text(encoding="utf-8")
        if file.suffix != ".json":
            return {tag: [f"a photo of a {tag}."] for tag in (line.strip() for line in text.splitlines()) if tag}
        found = {tag: list(texts) for entry in json.loads(text) for tag, texts in entry.items()}
    except (OSError, ValueError, AttributeError, TypeError) as error:
        raise InputError(file, expected="a list of tags", found=str(error), advice=ADVICE) from None
    if len({len(texts) for texts in found.values()}) != 1 or not all(
        isinstance(t, str) for d in found.values() for t in d
    ):
        expected = "as many descriptions, all of them texts, for each tag"
        raise InputError(file, expected=expected, found="another number for some", advice=ADVICE)
    return found
