"""`uppm check`: what is wrong with a sequence, before it is mapped."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from uppm.datasets import SequenceCheck


def check(
    sequence: Annotated[
        Path, typer.Argument(readable=False, help="Folder or file of a posed RGB-D sequence.", show_default=False)
    ],
    format: Annotated[str | None, typer.Option(help="Reader; found by looking where not given.")] = None,
    depth_scale: Annotated[float | None, typer.Option(help="Depth image units a metre.")] = None,
    invert_poses: Annotated[bool, typer.Option("--invert-poses", help="Pose files are world-to-camera.")] = False,
    pose_axes: Annotated[str, typer.Option(help="Camera axes of the pose files: opencv or opengl.")] = "opencv",
    quaternion_order: Annotated[str, typer.Option(help="Quaternions in pose files: xyzw or wxyz.")] = "xyzw",
    set_: Annotated[list[str] | None, typer.Option("--set", help="One setting, as input.pose_topic=/odom.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Read about 24 frames instead of all.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="End at the first frame that cannot be used.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Judge a sequence's poses, depth scale, intrinsics and files from its data; exit status 1 with findings."""
    from uppm.core.config import Config
    from uppm.datasets import check_sequence, open_sequence

    settings = {
        "format": format,
        "depth_scale": depth_scale,
        "invert_poses": invert_poses,
        "pose_axes": pose_axes,
        "quaternion_order": quaternion_order,
        "strict": strict,
    }
    overrides = [f"input.{key}={json.dumps(value)}" for key, value in settings.items()]
    source = open_sequence(sequence, Config.load(overrides=[*overrides, *(set_ or [])]).input)
    result = check_sequence(source, quick=quick)
    if as_json:
        typer.echo(json.dumps(_as_dict(result), indent=2))
    else:
        _print(result)
    raise typer.Exit(0 if result.ok else 1)


def _finite(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None


def _as_dict(result: SequenceCheck) -> dict[str, Any]:
    return {
        "name": result.name,
        "format": result.format,
        "ok": result.ok,
        "frames": result.frames,
        "frames_read": result.frames_read,
        "unreadable": dict(result.unreadable),
        "pairs": result.pairs,
        "agreement_cm": _finite(result.agreement_cm),
        "candidates_cm": {name: _finite(value) for name, value in result.candidates.items()},
        "findings": [{"kind": each.kind, "text": each.text, "fix": each.fix} for each in result.findings],
    }


def _print(result: SequenceCheck) -> None:
    from rich.console import Console
    from rich.markup import escape

    console = Console(highlight=False, soft_wrap=True)
    console.print(f"{escape(result.name)}: {result.format}, {result.frames} frames, {result.frames_read} read")
    if not result.pairs:
        console.print("Too few frames can be used to judge poses, depth scale and intrinsics.")
    elif math.isfinite(result.agreement_cm):
        console.print(
            f"Median agreement of depths between frames: {result.agreement_cm:.1f} cm over {result.pairs} pairs"
        )
    for finding in result.findings:
        console.print(f"[bold yellow]{finding.kind}[/]: {escape(finding.text)}\n  fix: {escape(finding.fix)}")
    if result.ok:
        console.print("[green]Nothing looks wrong.[/]")
