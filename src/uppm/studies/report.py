"""The studies' results as the report of a regime: tables, plots, and a picture of each map."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from uppm.evaluation import html, plots
from uppm.regimes.pictures import legend_of_instances
from uppm.regimes.report import Report
from uppm.studies.ablation import Figures, cell
from uppm.studies.noise import CURVES, draw_curves
from uppm.studies.paper_tables import TABLES, PaperTable

PICTURED_LEVEL = 1.0
"""The curves' maps are shown at the level nearest to this, the default noise."""


def ablation_report(
    data: str, perception: str, tables: Sequence[Sequence[Mapping[str, Any]]], figures: Figures, folder: Path
) -> Report:
    """The paper's tables, ours beside its own figures; the rows of each of `TABLES` as `fill` gives them."""
    sections = [_paper_section(table, rows) for table, rows in zip(TABLES, tables, strict=True)]
    caption = "The noise is the same for all; the middle plot's band is the aim, 0.9 to 1.2."
    plot = html.image(_bars(figures), "image/svg+xml", caption)
    return Report(
        regime="ablation",
        title=f"Ablations: {data}, {perception}",
        results=figures,
        summary=[*sections, html.Section(title="All variants", body=plot)],
        sections=_pictures(figures.items(), folder),
    )


def noise_report(rows: Sequence[Mapping[str, Any]], folder: Path) -> Report:
    """The curves, and the maps at the default noise; rows as `noise_curves` gives them."""
    named = ((f"{r['sequence']}: {r['method']}, noise {r['level']:g}", r) for r in rows)
    results = {name: {**row, "method": name, "curve": row["method"]} for name, row in named}
    pictured = min((row["level"] for row in rows), key=lambda level: abs(level - PICTURED_LEVEL))
    headings = ["", *(title for _, title in CURVES)]
    table = html.table(headings, [[name, *(row[key] for key, _ in CURVES)] for name, row in results.items()])
    curves = html.image(plots.svg(draw_curves(rows)), "image/svg+xml", "Level 1: the default noise.")
    return Report(
        regime="noise",
        title=f"Quality against noise: {', '.join(dict.fromkeys(row['sequence'] for row in rows))}",
        results=results,
        summary=[html.Section(title="Curves", body=curves), html.Section(title="Their figures", body=table)],
        sections=_pictures(((n, r) for n, r in results.items() if r["level"] == pictured), folder),
    )


def _paper_section(table: PaperTable, rows: Sequence[Mapping[str, Any]]) -> html.Section:
    paper = bool(table.paper_data)
    body = html.table(
        ["", *(column.title for column in table.columns)],
        [[row["row"], *(cell(row, column, paper=paper) for column in table.columns)] for row in rows],
    )
    said = f"Ours / the paper's, which were measured on other data: {table.paper_data}." if paper else "Ours alone."
    return html.Section(title=table.title, body=body + html.paragraph(said))


def _bars(figures: Figures) -> bytes:
    drawn = plots.figure(9, 0.8 + 0.24 * len(figures))
    axes = drawn.subplots(1, len(CURVES), sharey=True)
    for axis, (key, title), color in zip(axes, CURVES, plots.COLORS, strict=False):
        axis.barh(list(figures), [f.get(key) or 0.0 for f in figures.values()], 0.7, color=color)
        axis.set_title(title, fontsize=9)
        axis.grid(axis="x", alpha=0.25)
        if key == "object_count_ratio":
            axis.axvspan(0.9, 1.2, color="0.9", zorder=0)
        else:
            axis.set(xlim=(0, 1), xticks=(0, 0.5, 1))
    axes[0].invert_yaxis()
    return plots.svg(drawn)


def _pictures(runs: Iterable[tuple[str, Mapping[str, Any]]], folder: Path) -> list[html.Section]:
    """The maps' right and wrong instances; a picture that a resumed study no longer has is left out."""
    legend = html.legend(legend_of_instances().items())
    files = [(name, folder / figures["picture"]) for name, figures in runs if figures.get("picture")]
    shown = [html.image(file.read_bytes(), "image/png", escape(name)) for name, file in files if file.is_file()]
    return [html.Section(title="Right and wrong instances", body="\n".join([f"<p>{legend}</p>", *shown]))]
