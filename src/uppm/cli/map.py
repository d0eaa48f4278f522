"""`uppm map`: a posed RGB-D sequence into a map file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uppm.cli.changes import print_changes
from uppm.cli.view import WatchedRun

if TYPE_CHECKING:
    from uppm.core.config import Config
    from uppm.core.protocols import FrameViewer
    from uppm.core.types import Report
    from uppm.datasets.sequence import PosedSequence


def map_command(
    sequence: Annotated[Path, typer.Argument(readable=False, help="Folder or file of a posed RGB-D sequence.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Map file to write.", metavar="MAP.uppm")],
    perception: Annotated[str | None, typer.Option(help="Front end, such as embedded or foundation.")] = None,
    precomputed: Annotated[Path | None, typer.Option(help="Folder of id images for `precomputed`.")] = None,
    format: Annotated[str | None, typer.Option(help="Reader; found by looking if not given.")] = None,
    stride: Annotated[int | None, typer.Option(min=1, help="Use every n-th frame.")] = None,
    max_frames: Annotated[int | None, typer.Option(min=1, help="Stop after so many frames.")] = None,
    depth_scale: Annotated[float | None, typer.Option(help="Depth image units a metre.")] = None,
    invert_poses: Annotated[bool | None, typer.Option("--invert-poses", help="Poses are camera-from-world.")] = None,
    pose_axes: Annotated[str | None, typer.Option(help="Camera axes of the poses: opencv or opengl.")] = None,
    quaternion_order: Annotated[str | None, typer.Option(help="xyzw or wxyz.")] = None,
    up: Annotated[str | None, typer.Option(help="Up axis of the map: auto, +x, -x, +y, -y, +z or -z.")] = None,
    config: Annotated[str | None, typer.Option(help="YAML file of settings, or uppm, paper, panmap.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="One setting, as fusion.truncation=3.")] = None,
    checkpoint_every: Annotated[int | None, typer.Option(min=1, help="Frames between checkpoints.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an existing map.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing map.")] = False,
    strict: Annotated[bool | None, typer.Option("--strict", help="End at the first bad frame.")] = None,
    check: Annotated[bool, typer.Option(help="Judge poses, scale and intrinsics first.")] = True,
    onto: Annotated[Path | None, typer.Option(help="Older map: say what changed since.", metavar="MAP.uppm")] = None,
    align: Annotated[bool, typer.Option("--align", help="Estimate where the older map lies in this one.")] = False,
    view: Annotated[bool, typer.Option("--view", help="Show the map in the browser while it is made.")] = False,
    view_host: Annotated[str, typer.Option(help="As `uppm view --host`.")] = "127.0.0.1",
    view_port: Annotated[int, typer.Option(min=0, max=65535, help="As `uppm view --port`.")] = 8080,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Map a posed RGB-D sequence into one file that answers questions."""
    from uppm.core.config import Config
    from uppm.datasets.registry import open_sequence
    from uppm.perception.provision import provide
    from uppm.pipeline import compare_maps

    options = {
        "perception.profile": perception,
        "perception.precomputed": str(precomputed) if precomputed else None,
        "perception.up": up,
        "input.format": format,
        "input.stride": stride,
        "input.max_frames": max_frames,
        "input.depth_scale": depth_scale,
        "input.invert_poses": invert_poses,
        "input.pose_axes": pose_axes,
        "input.quaternion_order": quaternion_order,
        "input.strict": strict,
        "map.checkpoint_every": checkpoint_every,
    }
    given = [f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in options.items() if value is not None]
    settings = Config.load(config, [*(set_ or []), *given])
    check_onto(onto, output, align=align)
    if resume:
        settings = own_settings(output, settings, overwrite=overwrite)
    source = open_sequence(sequence, settings.input)
    if not resume:
        provide(settings.perception)
    if check and not resume:
        warn_or_stop(source, quiet=as_json)
    watched = WatchedRun(view_host, view_port, source) if view else None
    viewer = watched.viewer if watched else None
    report = run(source, output, settings, resume=resume, overwrite=overwrite, quiet=as_json, viewer=viewer)
    compared = compare_maps(onto, output, source, align=align) if onto else None
    if as_json:
        changes = {"changes": compared.to_dict()["changes"]} if compared else {}
        typer.echo(json.dumps({"map": str(output), **report_dict(report), **changes}, indent=2))
    else:
        print_report(report, output)
        if compared:
            print_changes(compared)
    if watched:
        watched.stay(output)


def check_onto(onto: Path | None, output: Path, *, align: bool) -> None:
    """Say before a sequence is mapped what would fail after it."""
    from uppm.core.errors import InputError
    from uppm.pipeline import open_map

    if onto is None:
        if align:
            raise InputError("--align", expected="an older map with it", found="none", advice="name it with --onto")
        return
    open_map(onto)
    if onto.resolve() == output.resolve():
        advice = "name another file for the new map"
        raise InputError(onto, expected="an older map than the one to write", found="the same file", advice=advice)


def own_settings(output: Path, asked: Config, *, overwrite: bool) -> Config:
    """The settings of the map to go on with; those that were asked for may not contradict them."""
    from uppm.core.errors import ConfigError
    from uppm.pipeline import open_map, saved_config

    if overwrite:
        advice = "say which"
        raise ConfigError("map", expected="one of --resume and --overwrite", found="both", advice=advice)
    own = saved_config(open_map(output).meta)
    for section in sorted(asked.model_fields_set):
        mine, wanted = getattr(own, section), getattr(asked, section)
        for name in sorted(wanted.model_fields_set):
            ours, theirs = getattr(mine, name), getattr(wanted, name)
            if ours != theirs:
                expected = f"the map's own {section}.{name}, {ours}"
                raise ConfigError(output, expected=expected, found=str(theirs), advice="drop it, or begin a new map")
    return own


def warn_or_stop(source: PosedSequence, *, quiet: bool) -> None:
    """The quick check: conventions that are wrong end the run, anything else is a warning."""
    from uppm.core.errors import InputError
    from uppm.datasets.check import check_sequence

    result = check_sequence(source, quick=True)
    for finding in result.findings:
        if set(finding.kind.split("+")) & {"poses", "depth-scale", "intrinsics"}:
            raise InputError(
                source.name,
                expected="poses, depth scale and intrinsics under which neighbouring frames agree",
                found=finding.text,
                advice=f"{finding.fix}, or map it as it is with --no-check",
            )
        typer.echo(f"warning: {finding}", err=True)
    if not quiet:
        agreement = f"; neighbouring ones agree within {result.agreement_cm:.1f} cm" if result.pairs else ""
        typer.echo(f"{source.name}: {len(source)} frames{agreement}")


def run(
    source: PosedSequence,
    output: Path,
    config: Config,
    *,
    resume: bool,
    overwrite: bool,
    quiet: bool,
    viewer: FrameViewer | None = None,
) -> Report:
    """Map with a progress bar; says so when kernels are compiled first."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from uppm.pipeline import map_sequence

    console = Console(stderr=True, quiet=quiet)
    # Only for eyes: what is redirected from standard error holds warnings and errors alone.
    shown = console.is_terminal and not quiet
    if shown:
        console.print("[dim]The first run on a machine compiles its kernels, for about half a minute.[/dim]")
    columns = TextColumn("mapping"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=not shown) as progress:
        task = progress.add_task("mapping", total=len(source))

        def show(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)

        options = {"resume": resume, "overwrite": overwrite}
        return map_sequence(source, output, config, **options, progress=show, viewer=viewer)


def report_dict(report: Report) -> dict[str, object]:
    """The report for programs; `frames_per_second` counts perception, retrieval and fusion."""
    per_frame = sum(report.seconds.get(stage, 0.0) for stage in ("perception", "retrieval", "fusion"))
    return {
        "frames": report.frames,
        "frames_per_second": round(report.frames / per_frame, 2) if per_frame else None,
        "skipped": dict(report.skipped),
        "dropped": dict(report.dropped),
        "seconds": {stage: round(s, 3) for stage, s in report.seconds.items()},
    }


def print_report(report: Report, output: Path) -> None:
    """The report for people."""
    speed = report_dict(report)["frames_per_second"]
    typer.echo(f"{output}: {report.frames} frames" + (f", {speed} frames a second" if speed else ""))
    for stage, seconds in report.seconds.items():
        typer.echo(f"  {stage:<12}{seconds:8.2f} s")
    for title, counts in (("skipped frames", report.skipped), ("dropped", report.dropped)):
        for reason, count in counts.items():
            typer.echo(f"  {title}: {count} x {reason.replace('_', ' ')}")
