"""Figures of the reports, drawn with matplotlib (extra `eval`) without a display; same input, same bytes."""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import MissingExtraError

COMMAND = "pip install uppm[eval]"
COLORS = ("#2654a2", "#d1613a", "#4f9d63", "#8a63b5", "#c9a227", "#5f6b7a", "#b23a6f", "#3f97a8")
LINES = ("-", "--", "-.", ":")
"""Styles of curves, so that those which lie on each other can be told apart."""
LEFT = {"completion_ratio_5cm": "completion ratio, %", "f1_5cm": "F1, %", "pq_3d": "PQ (3D), %"}
"""Shares, higher is better."""
RIGHT = {"chamfer_cm": "Chamfer", "hausdorff_95_cm": "Hausdorff 95 %", "accuracy_cm": "accuracy"}
"""Lengths, lower is better."""


def figure(width: float, height: float) -> Any:
    """A figure, inches; raises `MissingExtraError` without matplotlib."""
    try:
        from matplotlib.figure import Figure  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise MissingExtraError("matplotlib, which draws the report's plots,", COMMAND) from None
    return Figure(figsize=(width, height), layout="constrained")


def svg(drawn: Any) -> bytes:
    """The figure as SVG, its letters as paths, so that it looks the same everywhere."""
    import matplotlib  # pyright: ignore[reportMissingImports]

    out = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "uppm", "svg.fonttype": "path"}):
        drawn.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()


def distance_curves(
    distances: Mapping[str, tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]]], limit: float = 0.1
) -> bytes:
    """For each method, the share of R within a distance of G, and of G within one of R; metres, up to `limit`."""
    drawn = figure(9, 3.4)
    axes = drawn.subplots(1, 2, sharey=True)
    at = np.linspace(0, limit, 201)
    for n, (color, (name, both)) in enumerate(zip(_colors(distances), distances.items(), strict=True)):
        for axis, values in zip(axes, both, strict=True):
            share = np.searchsorted(np.sort(values), at, side="right") / len(values)
            axis.plot(100 * at, 100 * share, color=color, label=name, linestyle=LINES[n % len(LINES)])
    for axis, title in zip(axes, ("reconstruction to ground truth", "ground truth to reconstruction"), strict=True):
        axis.set(title=title, xlabel="distance, cm", xlim=(0, 100 * limit), ylim=(0, 101))
        axis.axvline(5, color="#999999", linewidth=0.8, linestyle=":")
        axis.grid(alpha=0.25)
    axes[0].set_ylabel("share within, %")
    axes[1].legend(loc="lower right")
    return svg(drawn)


def class_bars(per_class: Mapping[str, Mapping[str, float]], methods: Sequence[str]) -> bytes:
    """PQ of each class for each method: method -> class -> 0 to 1; `methods` are all of the report, for the colours."""
    classes = sorted({name for values in per_class.values() for name in values})
    drawn = figure(9, max(1.6, 0.7 + 0.19 * len(classes) * max(1, len(per_class) / 2)))
    axis = drawn.subplots()
    thickness = 0.8 / len(per_class)
    colors = dict(zip(methods, _colors(methods), strict=True))
    for i, (method, values) in enumerate(per_class.items()):
        color, place = colors[method], np.arange(len(classes)) + (i - (len(per_class) - 1) / 2) * thickness
        axis.barh(place, [100 * values.get(c, 0.0) for c in classes], thickness, color=color, label=method)
    axis.set(xlim=(0, 100), xlabel="PQ, %", ylim=(-0.6, len(classes) - 0.4))
    axis.set_yticks(np.arange(len(classes)), classes, fontsize=7)
    axis.invert_yaxis()
    axis.grid(axis="x", alpha=0.25)
    axis.legend(loc="upper left", bbox_to_anchor=(1, 1))
    return svg(drawn)


def summary_chart(results: Mapping[str, Mapping[str, float | None]]) -> bytes:
    """The paper's figure of all data sets: shares on the left axis, lengths in cm on the right, a bar a method."""
    left = [key for key in LEFT if all(r.get(key) is not None for r in results.values())]
    right = [key for key in RIGHT if all(r.get(key) is not None for r in results.values())]
    drawn = figure(9, 3.6)
    first = drawn.subplots()
    second = first.twinx()
    _bars(first, results, left, 0, 100.0)
    _bars(second, results, right, len(left), 1.0)
    labels = [LEFT[key] for key in left] + [RIGHT[key] for key in right]
    first.set_xticks(np.arange(len(labels)), labels, fontsize=8)
    first.set(ylabel="higher is better, %", ylim=(0, 100))
    second.set(ylabel="lower is better, cm", ylim=(0, None))
    first.axvline(len(left) - 0.5, color="#999999", linewidth=0.8)
    drawn.legend(
        *(second if not left else first).get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=8
    )
    return svg(drawn)


def answer_probabilities(present: Sequence[float], absent: Sequence[float]) -> bytes:
    """How probable the best submap was, for prompts of what is there and of what is not; 0 to 1."""
    drawn = figure(9, 3.0)
    axis = drawn.subplots()
    labels, edges = (f"there ({len(present)} prompts)", f"not there ({len(absent)})"), np.linspace(0, 1, 21)
    axis.hist([present, absent], edges, label=labels, color=COLORS[:2])
    axis.set(xlabel="probability of the best submap", ylabel="prompts", xlim=(0, 1))
    axis.grid(axis="y", alpha=0.25)
    axis.legend(loc="upper center")
    return svg(drawn)


def right_and_wrong(groups: Mapping[str, tuple[int, int]]) -> bytes:
    """For each group how many were right and how many wrong, as stacked bars."""
    names, counts = list(groups), np.array(list(groups.values()), dtype=float).reshape(-1, 2)
    drawn = figure(9, 0.9 + 0.24 * len(names))
    axis = drawn.subplots()
    axis.barh(names, counts[:, 0], 0.7, color=COLORS[2], label="right")
    axis.barh(names, counts[:, 1], 0.7, left=counts[:, 0], color=COLORS[1], label="wrong")
    axis.set(xlabel="labels")
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.margins(y=0.01)
    axis.invert_yaxis()
    axis.grid(axis="x", alpha=0.25)
    axis.legend(loc="upper left", bbox_to_anchor=(1, 1))
    return svg(drawn)


def _bars(
    axis: Any, results: Mapping[str, Mapping[str, float | None]], keys: Sequence[str], start: int, factor: float
) -> None:
    thickness = 0.8 / len(results)
    for i, (color, (method, values)) in enumerate(zip(_colors(results), results.items(), strict=True)):
        heights = [factor * (values[key] or 0.0) for key in keys]
        place = start + np.arange(len(keys)) + (i - (len(results) - 1) / 2) * thickness
        axis.bar(place, heights, thickness, color=color, label=method)


def _colors(methods: Collection[str]) -> list[str]:
    return [COLORS[i % len(COLORS)] for i in range(len(methods))]
