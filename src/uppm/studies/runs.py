"""The runs of a study: each maps a sequence with some settings; finished ones are kept on disk and not run again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from uppm.core.config import Config
from uppm.core.errors import InputError

Measure = Callable[[Path, Config, Path], dict[str, Any]]
"""Sequence, configuration, and the PNG file to draw the map to -> metrics."""


@dataclass(kw_only=True, eq=False)
class Runs:
    """What was measured so far.

    Parameters
    ----------
    file : Path
        Where it is kept.
    measure : Measure
    """

    file: Path
    measure: Measure
    done: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])

    @classmethod
    def open(cls, file: Path, measure: Measure, *, resume: bool) -> Runs:
        """Begin a study, or go on with the one of a file."""
        file.parent.mkdir(parents=True, exist_ok=True)
        if not resume or not file.exists():
            return cls(file=file, measure=measure)
        try:
            done = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            advice = "delete it, or drop --resume"
            raise InputError(file, expected="the runs of a study", found=str(error), advice=advice) from None
        return cls(file=file, measure=measure, done=done)

    def __call__(self, sequence: Path, config: Config) -> dict[str, Any]:
        """The metrics of one run, measured now or before, and `picture`: its name beside `file`."""
        key = f"{sequence.name} {config.model_dump_json()}"
        if key not in self.done:
            picture = self.file.with_name(f"{hashlib.sha256(key.encode()).hexdigest()[:12]}.png")
            self.done[key] = self.measure(sequence, config, picture) | {"picture": picture.name}
            self.file.write_text(json.dumps(self.done, indent=1), encoding="utf-8")
        return self.done[key]
