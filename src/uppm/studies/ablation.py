"""The paper's ablations (section 4.5): one sequence, one variant after another, the paper's tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from uppm.core.config import Config
from uppm.studies.paper_tables import VARIANTS, Column, PaperTable, Row
from uppm.studies.runs import Runs

Figures = Mapping[str, Mapping[str, Any]]
"""Variant -> metric -> value."""
Progress = Callable[[str, int, int], None]
"""Told of each variant before it is measured: its name, how many were, how many there are."""


def run_ablation(
    sequence: Path,
    source: Path | None,
    settings: Sequence[str],
    runs: Runs,
    progress: Progress = lambda name, done, total: None,
) -> dict[str, dict[str, Any]]:
    """Metrics of every variant that a table shows.

    Parameters
    ----------
    sequence : Path
        Sequence with ground truth.
    source : Path or None
        Configuration file; None: the defaults.
    settings : sequence of str
        For every variant, before its own.
    runs : Runs
        Of `measure`.
    """
    figures: dict[str, dict[str, Any]] = {}
    for done, (name, own) in enumerate(VARIANTS.items()):
        progress(name, done, len(VARIANTS))
        figures[name] = runs(sequence, Config.load(source, [*settings, *own]))
    return figures


def fill(table: PaperTable, figures: Figures) -> list[dict[str, Any]]:
    """A table's rows: title, and for each column what was measured and the paper's figure, or None."""
    return [_filled(table, row, figures) for row in table.rows]


def _filled(table: PaperTable, row: Row, figures: Figures) -> dict[str, Any]:
    paper = dict(zip((c.key for c in table.columns), row.paper, strict=False))
    ours = {c.key: _figure(table, row, c.key, c.scale, figures) for c in table.columns}
    change = row.against is not None
    return {"row": row.title, "variant": row.variant, "change": change, "ours": ours, "paper": paper}


def _figure(table: PaperTable, row: Row, key: str, scale: float, figures: Figures) -> float | None:
    value = figures[row.variant].get(key)
    if value is None or row.against is None:
        return None if value is None else value * scale
    before = figures[row.against].get(key)
    if before is None:
        return None
    if key in table.relative:
        return 100 * (value - before) / before if before else None
    return (value - before) * scale


def cell(row: Mapping[str, Any], column: Column, *, paper: bool) -> str:
    """A filled row's figure in one column as text, with the paper's own behind it if asked for."""
    sign = "+" if row["change"] else ""
    figures = (row["ours"].get(column.key), row["paper"].get(column.key))
    texts = ["-" if f is None else f"{f:{sign}.{column.digits}f}" for f in figures]
    return " / ".join(texts) if paper else texts[0]
