"""Quality against the noise of simulated perception, for UPPM, PPM and Panoptic Multi-TSDFs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from uppm.core.config import Config
from uppm.evaluation import plots
from uppm.studies.paper_tables import VARIANTS
from uppm.studies.runs import Runs

LEVELS = (0.0, 0.5, 1.0, 1.5, 2.0)
"""1: the default noise (docs/simulated.md)."""


METHODS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "UPPM": ("uppm", ()),
    "PPM": ("uppm", VARIANTS["ppm"][1:]),
    "panmap": ("panmap", ()),
}
"""Curve -> its preset and settings."""
CURVES = (
    ("pq_3d", "PQ (3D)"),
    ("object_count_ratio", "objects / true objects"),
    ("query_recall", "recall, every name asked"),
)
"""Metric and axis of each plot."""

Progress = Callable[[str, float, str], None]
"""Told of each run before it is made: the method, the level, the sequence."""


def noise_curves(
    sequences: Sequence[Path],
    levels: Sequence[float],
    settings: Sequence[str],
    runs: Runs,
    progress: Progress = lambda method, level, sequence: None,
) -> list[dict[str, Any]]:
    """One row a sequence, method and level, with all metrics."""
    rows: list[dict[str, Any]] = []
    for sequence in sequences:
        for name, (preset, own) in METHODS.items():
            for level in levels:
                progress(name, level, sequence.name)
                given = ["perception.profile=simulated", *settings, *own, f"perception.simulated.level={level}"]
                config = Config.load(preset, given)
                row = {"sequence": sequence.name, "method": name, "level": level}
                rows.append(row | runs(sequence, config))
    return rows


def draw_curves(rows: Sequence[Mapping[str, Any]]) -> Any:
    """A matplotlib figure: one row of plots a sequence, one plot a metric, one line a method.

    Raises
    ------
    MissingExtraError
        matplotlib is not installed.
    """
    sequences = list(dict.fromkeys(row["sequence"] for row in rows))
    drawn = plots.figure(4.2 * len(CURVES), 3.2 * len(sequences))
    axes = drawn.subplots(len(sequences), len(CURVES), squeeze=False)
    for line, sequence in zip(axes, sequences, strict=True):
        for axis, (metric, title) in zip(line, CURVES, strict=True):
            _draw(axis, [row for row in rows if row["sequence"] == sequence], metric)
            axis.set(title=f"{sequence}: {title}", xlabel="noise level")
    drawn.legend(*axes[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=len(METHODS), frameon=False)
    return drawn


def _draw(axis: Any, rows: Sequence[Mapping[str, Any]], metric: str) -> None:
    for method, color in zip(METHODS, plots.COLORS, strict=False):
        points = [(row["level"], row[metric]) for row in rows if row["method"] == method and row[metric] is not None]
        axis.plot(*zip(*points, strict=True), marker="o", markersize=4, label=method, color=color)
    if metric == "object_count_ratio":
        axis.axhspan(0.9, 1.2, color="0.9", zorder=0)
    else:
        axis.set_ylim(0, 1.02)
    axis.grid(alpha=0.3)
