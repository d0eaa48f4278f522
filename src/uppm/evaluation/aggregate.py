"""Results of several sequences as one: the paper's weighted averages over data sets (section 4)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from uppm.core.errors import InputError

WEIGHT = "ground_truth_points"
"""A sequence counts by the surface that its cameras saw: points of G lie at one distance from each other."""
_ABOUT = ("points_per_m2", "seed")
"""Settings, not results."""

Result = Mapping[str, Any]


def read_results(file: Path) -> list[Result]:
    """The results of a report.json, or of what `--json` printed; raises `InputError` naming the file at fault."""
    expected, advice = "the report.json of a regime with ground truth", "write it with `uppm evaluate ... --output DIR`"
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        found = "no such file" if isinstance(error, FileNotFoundError) else str(error).splitlines()[0]
        raise InputError(file, expected=expected, found=found, advice=advice) from None
    if isinstance(content, dict):
        content = content.get("results", [content])
    for result in content if isinstance(content, list) else [None]:
        if not isinstance(result, dict) or not isinstance(result.get("method"), str):
            raise InputError(file, expected=expected, found="other JSON", advice=advice)
        if not isinstance(result.get(WEIGHT), int) or result[WEIGHT] < 1:
            found = f"no {WEIGHT} for {result['method']}"
            raise InputError(file, expected=expected, found=found, advice=advice)
    if not content:
        raise InputError(file, expected=expected, found="no results", advice=advice)
    return content


def aggregate(results: Iterable[Result]) -> dict[str, dict[str, Any]]:
    """Method -> `sequences`, and each figure over them: whole numbers added up, others averaged by `WEIGHT`.

    Where a sequence has no value for a figure, the figure is over the others.
    """
    methods: dict[str, list[Result]] = {}
    for result in results:
        methods.setdefault(result["method"], []).append(result)
    return {method: _combined(found) for method, found in methods.items()}


def _combined(results: Sequence[Result]) -> dict[str, Any]:
    keys = dict.fromkeys(key for result in results for key, value in result.items() if _is_number(value))
    combined: dict[str, Any] = {"sequences": len(results)}
    for key in keys:
        having = [result for result in results if _is_number(result.get(key))]
        if key in _ABOUT:
            continue
        if all(isinstance(result[key], int) for result in having):
            combined[key] = sum(result[key] for result in having)
        else:
            total = sum(result[WEIGHT] for result in having)
            combined[key] = sum(result[key] * result[WEIGHT] for result in having) / total
    return combined


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
