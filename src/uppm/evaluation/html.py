"""Reports as one HTML file that needs no other file and no network."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from string import Template
from typing import Any

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; color: #1d2530; max-width: 1100px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; border-bottom: 1px solid #d8dde4; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .15rem .8rem .15rem 0; text-align: right; vertical-align: top; }
td { max-width: 15rem; overflow-wrap: break-word; } th { vertical-align: bottom; }
th:first-child, td:first-child, .text { text-align: left; } td:first-child { white-space: nowrap; }
thead th { border-bottom: 1px solid #8893a3; } tbody tr:hover { background: #f3f5f8; }
.wide { overflow-x: auto; } .wide td:first-child { position: sticky; left: 0; background: #fff; }
figure { margin: 1rem 0; } figure img { max-width: 100%; } figcaption { color: #56606e; font-size: .9rem; }
.note { background: #fff6dd; border-left: 4px solid #e0b13a; padding: .4rem .8rem; }
.entry { white-space: nowrap; margin-right: .9em; }
.key { display: inline-block; width: .9em; height: .9em; margin-right: .35em; vertical-align: -.1em; }
</style>
</head>
<body>
<h1>$title</h1>
$body
</body>
</html>
""")


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading and what stands under it."""

    title: str
    body: str
    """HTML."""


def page(title: str, sections: Iterable[Section]) -> str:
    """The whole file."""
    body = "\n".join(f"<h2>{escape(s.title)}</h2>\n{s.body}" for s in sections)
    return _PAGE.substitute(title=escape(title), body=body)


def table(headings: Sequence[str], rows: Iterable[Sequence[Any]], text: int = 1) -> str:
    """A table; the first column, or as many as `text` says, are text, the others numbers."""
    head = "".join(f"<th{_side(n, text)}>{escape(h)}</th>" for n, h in enumerate(headings))
    lines = ("<tr>" + "".join(_cell(cell, _side(n, text)) for n, cell in enumerate(row)) + "</tr>" for row in rows)
    body = "\n".join(lines)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table></div>'


def _side(column: int, text: int) -> str:
    return ' class="text"' if 0 < column < text else ""


def _cell(value: Any, side: str) -> str:
    return f"<td{side}>{escape(shown(value))}</td>"


def image(data: bytes, kind: str, caption: str) -> str:
    """A picture within the file; `kind` is its MIME type, the caption HTML."""
    encoded = base64.b64encode(data).decode()
    return f'<figure><img alt="" src="data:{kind};base64,{encoded}"><figcaption>{caption}</figcaption></figure>'


def legend(entries: Iterable[tuple[tuple[int, int, int], str]]) -> str:
    """Colours (RGB) and what they mean."""
    return " ".join(
        f'<span class="entry"><span class="key" style="background: rgb{rgb}"></span>{escape(text)}</span>'
        for rgb, text in entries
    )


def note(text: str) -> str:
    """A warning."""
    return f'<p class="note">{escape(text)}</p>'


def paragraph(text: str) -> str:
    """Plain text."""
    return f"<p>{escape(text)}</p>"


def shown(value: Any) -> str:
    """A cell: three decimals, '-' for nothing."""
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)
