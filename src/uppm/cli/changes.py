"""What changed between two visits, as a table; part of `uppm map --onto` and `uppm info`."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from uppm.map.panoptic_map import PanopticMap


def print_changes(panoptic: PanopticMap) -> None:
    """Every object that did not simply stay, and how many did; nothing where no older map was compared."""
    from collections import Counter

    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from uppm.cli.info import numbers
    from uppm.core.types import ChangeState

    notes = panoptic.meta.provenance
    if "onto" not in notes:
        return
    console = Console()
    table = Table(
        title=escape(f"since {notes['onto']}"), title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0)
    )
    for column in ("", "object", "category", "id then", "now", "center then, m", "now, m"):
        table.add_column(column, no_wrap=column not in ("object", "category"))
    for c in panoptic.changes:
        if c.state is not ChangeState.PERSISTENT:
            ids = ("-" if id_ is None else str(id_) for id_ in (c.id_old, c.id_new))
            places = ("-" if place is None else numbers(place) for place in (c.center_old, c.center_new))
            table.add_row(*map(escape, (c.state.value, c.label, c.category, *ids, *places)))
    console.print(table)
    counts = Counter(c.state for c in panoptic.changes)
    console.print(", ".join(f"{counts[state]} {state.value}" for state in ChangeState))
    if "onto.fitness" in notes:
        fit = f"{float(notes['onto.fitness']):.1%} of its surface, {100 * float(notes['onto.rmse']):.2f} cm RMSE"
        console.print(f"aligned with the older map: {fit}")
