"""`uppm info`: what a map holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from uppm.map.panoptic_map import PanopticMap


def info(
    path: Annotated[Path, typer.Argument(metavar="MAP", help="Map file written by `uppm map`.")],
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
    from rich.table import Table

    from uppm.core.types import SubmapKind

    table = Table("id", "object", "category", "conf.", "labels", "center [m]", "size [m]", "voxel", "state")
    for submap in sorted(panoptic.submaps, key=lambda s: (s.kind is not SubmapKind.OBJECT, s.id)):
        if not submap.descriptor:
            continue
        d = submap.descriptor
        labels = ", ".join(f"{record.text} {record.count}" for record in d.labels[:3])
        name = d.labels[0].text if submap.kind is SubmapKind.OBJECT and d.labels else "-"
        shape = (numbers(submap.center), numbers(submap.extent), f"{100 * submap.voxel_size:.0f} cm")
        table.add_row(str(submap.id), name, d.category.name, f"{d.confidence:.2f}", labels, *shape, submap.state.value)
    console = Console()
    console.print(table)
    console.print(f"{panoptic.report.frames} frames, {len(panoptic.objects)} objects, {len(panoptic.submaps)} submaps")
    for title, counts in (("frames skipped", panoptic.report.skipped), ("dropped", panoptic.report.dropped)):
        if counts:
            console.print(f"{title}: {_listed(counts)}")


def numbers(values: object) -> str:
    """Three lengths as text; `-` for those that were not seen."""
    import numpy as np

    return " ".join(f"{v:.2f}" if np.isfinite(v) else "-" for v in np.asarray(values).tolist())


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{reason} {count}" for reason, count in sorted(counts.items(), key=lambda item: -item[1]))
