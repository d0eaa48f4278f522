"""What is known of one object, as HTML for the served page's panel."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from uppm.core.shown import CHANGE_COLORS, Answers, Shown

NO_PICTURES = "No pictures: the map keeps none. Start the viewer with --sequence."
_BAR = "background:linear-gradient(90deg,#f4c08a {share}%,transparent {share}%);padding:1px 6px;margin:2px 0"


def facts_html(shown: Shown, jpegs: Sequence[bytes]) -> str:
    """Labels with their counts as bars, category, sizes, frames, pictures. Labels are escaped: a network wrote them."""
    labels = shown.facts["labels"]
    most = max([1, *labels.values()])
    bars = [
        f'<div style="{_BAR.format(share=round(100 * count / most))}">{escape(label)} · {count}</div>'
        for label, count in labels.items()
    ]
    rows = "".join(f"<tr><td>{name}</td><td>{escape(value)}</td></tr>" for name, value in _rows(shown).items())
    images = [base64.b64encode(jpeg).decode() for jpeg in jpegs]
    pictures = [f'<img src="data:image/jpeg;base64,{i}" style="height:84px;margin:4px 4px 0 0">' for i in images]
    below = "".join(pictures) or f"<small>{NO_PICTURES}</small>"
    title = f"<b>{escape(shown.name)} #{shown.submap.id}</b>"
    return f'<div style="font-size:13px;padding:4px 10px">{title}{"".join(bars)}<table>{rows}</table>{below}</div>'


def answers_html(answers: Answers) -> str:
    """How a prompt was understood, and its answers."""
    lines = "".join(f"<div>{escape(line)}</div>" for line in answers.said)
    return f'<div style="font-size:13px;padding:4px 10px">{lines}</div>'


def changes_html(shown: Sequence[Shown], gone: Sequence[Mapping[str, Any]]) -> str:
    """What became of an older map's objects: how many of each state, in its colour, and those that are not here.

    Empty for a map that was compared with none.
    """
    states = [s.facts["change"]["state"] for s in shown if s.facts["change"]] + [g["state"] for g in gone]
    counts = Counter(states)
    legend = [
        f'<div><span style="color:rgb{color}">&#9632;</span> {state} · {counts[state]}</div>'
        for state, color in CHANGE_COLORS.items()
        if counts[state]
    ]
    lines = [f"<div>{escape(gone_name(g))}</div>" for g in gone]
    missing = ["<div><b>Not in this map</b></div>", *lines] if lines else []
    text = "".join([*legend, *missing])
    return f'<div style="font-size:13px;padding:4px 10px">{text}</div>' if text else ""


def gone_name(change: Mapping[str, Any]) -> str:
    """An older map's object that this one lacks."""
    return f"{change['label'] or change['category']} #{change['id_old']}: {change['state']}"


def _rows(shown: Shown) -> dict[str, str]:
    facts = shown.facts
    confidence = "" if facts["confidence"] is None else f" ({facts['confidence']:.0%})"
    rows = {
        "category": facts["category"] + confidence,
        "voxel": f"{100 * facts['voxel_size']:.0f} cm",
        "frames": f"{facts['first_frame']} to {facts['last_frame']}, seen in {facts['views']}",
        "size, m": " x ".join(f"{v:.2f}" for v in facts["extent"] or ()),
        "centre, m": ", ".join(f"{v:.2f}" for v in facts["center"] or ()),
        "state": facts["state"],
    }
    return rows | ({"since": facts["change"]["state"]} if facts["change"] else {})
