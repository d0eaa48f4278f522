"""A regime's results as files: report.json for programs, report.html for people, pictures beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.evaluation import html, plots
from uppm.evaluation.map_evaluation import Comparison
from uppm.export.files import write_bytes, write_json, write_png
from uppm.regimes.frame_pictures import LEGEND
from uppm.regimes.pictures import draw_errors, legend_of_instances

DEFINITIONS = "Definitions of all figures: docs/evaluation.md."
NESTED = ("matches", "per_class", "notes", "seconds", "answers", "picture", "misses", "groups")
"""Values that would not fit a table, or tell a reader nothing."""
DISTANCE_CAPTION = "Distance to the ground truth: blue 0 cm, yellow 2.5 cm, red 5 cm and more."
MISSED_CAPTION = "Red: ground truth without a reconstruction within 5 cm."


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportPicture:
    """A picture in the report and beside it."""

    file: str
    """Name, PNG."""
    image: npt.NDArray[np.uint8]
    """(H, W, 3), RGB."""
    caption: str
    """HTML."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Report:
    """What a regime found."""

    regime: str
    title: str
    results: Mapping[str, Mapping[str, Any]]
    """Method -> its flat figures."""
    comparisons: Mapping[str, Comparison] = field(default_factory=dict[str, Comparison])
    """Method -> what pictures are drawn of."""
    pictures: Mapping[str, Sequence[ReportPicture]] = field(default_factory=dict[str, Sequence[ReportPicture]])
    """Heading -> more pictures."""
    sections: Sequence[html.Section] = ()
    """More for the report, at its end."""
    summary: Sequence[html.Section] = ()
    """More for the report, before the table."""


def make_folder(folder: Path) -> None:
    """The folder that a report goes to, checked before anything is measured.

    Raises
    ------
    InputError
        It is a file, or its parent does not exist.
    MissingExtraError
        There is no matplotlib.
    """
    plots.figure(1, 1)
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, expected="a folder", found="a file", advice="name another for the report")
    if not folder.parent.is_dir():
        raise InputError(folder.parent, expected="a folder", found="nothing there", advice="make it or name another")
    folder.mkdir(exist_ok=True)


def write_report(folder: Path, report: Report) -> list[Path]:
    """Write report.html, report.json and the pictures; returns their paths."""
    sections = [*report.summary, html.Section(title="Figures", body=_figures(report))]
    written: list[Path] = []
    if report.comparisons:
        sections.append(html.Section(title="Distances", body=_curves(report.comparisons)))
    if any(result.get("per_class") for result in report.results.values()):
        sections.append(html.Section(title="Panoptic quality by class", body=_classes(report.results)))
    errors = {f"Where {name} is wrong": _errors(name, compared) for name, compared in report.comparisons.items()}
    for title, pictures in {**errors, **report.pictures}.items():
        files = [folder / picture.file for picture in pictures]
        for file, picture in zip(files, pictures, strict=True):
            write_png(file, picture.image)
        shown = (html.image(f.read_bytes(), "image/png", p.caption) for f, p in zip(files, pictures, strict=True))
        sections.append(html.Section(title=title, body="\n".join(shown)))
        written += files
    sections += report.sections
    write_bytes(folder / "report.html", html.page(report.title, sections).encode())
    write_json(folder / "report.json", to_json(report))
    return [folder / "report.html", folder / "report.json", *written]


def to_json(report: Report) -> dict[str, Any]:
    """What report.json holds, and `uppm evaluate aggregate` reads."""
    results = [{"method": method, **result} for method, result in report.results.items()]
    return {"regime": report.regime, "uppm": version("uppm"), "results": results}


def rows(results: Mapping[str, Mapping[str, Any]]) -> list[tuple[Any, ...]]:
    """A row a figure, a column a method."""
    names: dict[str, None] = {}
    for result in results.values():
        names |= dict.fromkeys(name for name in result if name not in NESTED)
    return [(name, *(result.get(name) for result in results.values())) for name in names]


def _figures(report: Report) -> str:
    notes = [
        html.note(f"{method}: {note}") for method, result in report.results.items() for note in result.get("notes", ())
    ]
    table = html.table(["", *report.results], rows(report.results))
    return "\n".join([*notes, table, html.paragraph(DEFINITIONS)])


def _curves(comparisons: Mapping[str, Comparison]) -> str:
    pairs = {m: (c.nearest.to_truth, c.nearest.to_reconstruction) for m, c in comparisons.items()}
    caption = "Left: accuracy and precision. Right: completeness and completion. Dotted: 5 cm."
    return html.image(plots.distance_curves(pairs), "image/svg+xml", caption)


def _classes(results: Mapping[str, Mapping[str, Any]]) -> str:
    values = {
        method: {name: quality(counts) for name, counts in result["per_class"].items()}
        for method, result in results.items()
        if result.get("per_class")
    }
    caption = "Classes of the truth and of the prediction; one that was only predicted has 0."
    return html.image(plots.class_bars(values, list(results)), "image/svg+xml", caption)


def quality(counts: Mapping[str, Any]) -> float:
    """PQ of the counts of one class: the sum of its matches' IoU over TP + FP/2 + FN/2."""
    return counts["iou"] / (counts["tp"] + counts["fp"] / 2 + counts["fn"] / 2)


def _errors(method: str, comparison: Comparison) -> list[ReportPicture]:
    drawn = draw_errors(comparison)
    found = {"distance": (drawn.distance, DISTANCE_CAPTION), "missed": (drawn.missed, MISSED_CAPTION)}
    if drawn.instances is not None:
        found["instances"] = drawn.instances, html.legend(legend_of_instances().items())
    return [
        ReportPicture(file=f"{method}_{name}.png", image=image, caption=caption)
        for name, (image, caption) in found.items()
    ]


def frame_pictures(method: str, drawn: Mapping[int, npt.NDArray[np.uint8]]) -> list[ReportPicture]:
    """The pictures of a few frames, by `Frame.index`."""
    legend = html.legend((error.value, text) for error, text in LEGEND.items())
    said = "the frame, its true instances, its segments."
    return [
        ReportPicture(file=f"{method}_frame_{n}.png", image=image, caption=f"Frame {n}: {said}<br>{legend}")
        for n, image in drawn.items()
    ]
