"""`uppm info`: what a map holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uppm.cli.changes import print_changes

if TYPE_CHECKING:
    from rich.table import Table

    from uppm.map.panoptic_map import PanopticMap

WIDE = 110
"""Columns of a terminal from which on the table shows everything."""


def info(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """What a map holds: objects and background with labels, place and size, and what was left out of it."""
    from uppm.pipeline import open_map

    panoptic = open_map(path)
    if as_json:
        typer.echo(json.dumps(panoptic.to_dict(), indent=2, ensure_ascii=False))
    else:
        print_map(panoptic)


def print_map(panoptic: PanopticMap) -> None:
    """The map's submaps as a table, and its report."""
    from rich.console import Console

    console = Console()
    console.print(_table(panoptic, wide=console.width >= WIDE))
    console.print(f"{panoptic.report.frames} frames, {len(panoptic.objects)} objects, {len(panoptic.submaps)} submaps")
    for title, counts in (("frames skipped", panoptic.report.skipped), ("dropped", panoptic.report.dropped)):
        if counts:
            console.print(f"{title}: {_listed(counts)}")
    if panoptic.corrections:
        console.print(f"{len(panoptic.corrections)} corrections by hand; `uppm edit MAP` lists them", markup=False)
    print_changes(panoptic)


def _table(panoptic: PanopticMap, *, wide: bool) -> Table:
    """Objects first; labels with their counts, voxel size and state where the terminal has room for them."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    from uppm.core.types import SubmapKind

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for title in ("id", "object", "category", "conf.", "center, m", "size, m"):
        table.add_column(title, no_wrap=title not in ("object", "category"))
    for title in ("voxel", "state", "labels") if wide else ():
        table.add_column(title)
    for submap in sorted(panoptic.submaps, key=lambda s: (s.kind is not SubmapKind.OBJECT, s.id)):
        if not submap.descriptor:
            continue
        d = submap.descriptor
        name = d.labels[0].text if submap.kind is SubmapKind.OBJECT and d.labels else "-"
        row = [str(submap.id), name, d.category.name, f"{d.confidence:.2f}"]
        row += [numbers(submap.center), numbers(submap.extent)]
        if wide:
            labels = ", ".join(f"{record.text} {record.count}" for record in d.labels[:3])
            row += [f"{100 * submap.voxel_size:.0f} cm", submap.state.value, labels]
        table.add_row(*map(escape, row))
    return table


def numbers(values: object) -> str:
    """Three lengths as text; `-` for those that were not seen."""
    import numpy as np

    return " ".join(f"{v:.2f}" if np.isfinite(v) else "-" for v in np.asarray(values).tolist())


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(
        f"{reason.replace('_', ' ')} {count}" for reason, count in sorted(counts.items(), key=lambda item: -item[1])
    )
