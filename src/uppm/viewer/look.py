"""How the served page shows a map at a time, and what that makes of each submap."""

from __future__ import annotations

from dataclasses import dataclass, field

from uppm.core.shown import Color, Coloring, Shown

BEST_COLOR: Color = (255, 60, 30)
ANSWER_COLOR: Color = (255, 140, 20)
DIMMED_COLOR: Color = (92, 96, 104)
DIMMED_OPACITY = 0.28


@dataclass(frozen=True, kw_only=True)
class Look:
    """What was chosen in the panel."""

    coloring: Coloring = "texture"
    hidden: frozenset[str] = frozenset()
    """Categories that are not shown."""
    answers: tuple[int, ...] = ()
    """Submaps that answer the prompt, the best first."""
    selected: int | None = None
    """Submap that was clicked."""
    until: int | None = None
    """Only what was seen by this frame is shown; None: everything."""
    free: bool = False
    path: bool = False


@dataclass(frozen=True, kw_only=True)
class Style:
    """How one submap is drawn."""

    visible: bool
    textured: bool = True
    """By its voxels' colours; else in one colour."""
    color: Color = field(default=DIMMED_COLOR)
    opacity: float | None = None
    """None: solid."""


def style_of(shown: Shown, look: Look) -> Style:
    """Answers and what was clicked are coloured, all else is dimmed while there are answers."""
    id_ = shown.submap.id
    late = look.until is not None and shown.submap.first_frame > look.until
    if late or shown.facts["category"] in look.hidden:
        return Style(visible=False)
    if id_ == look.selected or id_ in look.answers[:1]:
        return Style(visible=True, textured=False, color=BEST_COLOR)
    if id_ in look.answers:
        return Style(visible=True, textured=False, color=ANSWER_COLOR)
    if look.answers:
        return Style(visible=True, textured=False, color=DIMMED_COLOR, opacity=DIMMED_OPACITY)
    if look.coloring == "texture":
        return Style(visible=True)
    return Style(visible=True, textured=False, color=shown.colors[look.coloring])
