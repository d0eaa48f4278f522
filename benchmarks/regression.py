"""Hold the demo scene's figures to those of regression.json: `python benchmarks/regression.py [--update]`.

A figure that is worse than the noted one by more than its tolerance fails; one that is better by more is named, so that
`--update` can be run.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from uppm.cli.main import app

FILE = Path(__file__).with_name("regression.json")
PERCEPTION = "groundtruth,embedded"
OPTIONS = ("--set", "input.stride=2", "--points-per-m2", "2500", "--min-pixels", "500")
"""Every other frame and a quarter of the points: enough to tell worse from better."""
TOLERANCES = {
    "accuracy_cm": -0.05,
    "completeness_cm": -0.15,
    "hausdorff_95_cm": -0.5,
    "completion_ratio_5cm": 0.01,
    "f1_foreground_5cm": 0.01,
    "one_submap_ratio_things": 0.04,
    "things_found": 1,
    "category_accuracy": 0.04,
    "pq_3d": 0.03,
    "map_50": 0.04,
    "miou": 0.03,
    "id_switches": -5,
}
"""Figure -> how much worse it may become; negative where lower is better."""

Figures = Mapping[str, Mapping[str, float]]


def measure() -> dict[str, dict[str, float]]:
    """The figures of the demo scene with each front end."""
    with resources.as_file(resources.files("uppm.data") / "demo") as demo:
        arguments = ["evaluate", "sequence", str(demo), "--perception", PERCEPTION, *OPTIONS]
        run = CliRunner().invoke(app, [*arguments, "--json"], catch_exceptions=False)
    results: list[dict[str, Any]] = json.loads(run.stdout)
    return {r["method"]: {name: round(r[name], 4) for name in TOLERANCES} for r in results}


def differences(noted: Figures, found: Figures, *, worse: bool) -> list[str]:
    """What became worse, or better, than it was noted by more than the tolerance."""
    lines = []
    for method, figures in noted.items():
        for name, before in figures.items():
            gain = (found[method][name] - before) * (1 if TOLERANCES[name] > 0 else -1)
            if (-gain if worse else gain) > abs(TOLERANCES[name]):
                lines.append(f"{method}: {name} was {before:g}, is {found[method][name]:g}")
    return lines


def main() -> int:
    """Compare, or write the file anew."""
    found = measure()
    if "--update" in sys.argv[1:]:
        FILE.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
        return 0
    noted = json.loads(FILE.read_text(encoding="utf-8"))
    for line in differences(noted, found, worse=False):
        print(f"better: {line}")
    for line in (lost := differences(noted, found, worse=True)):
        print(f"worse: {line}")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
