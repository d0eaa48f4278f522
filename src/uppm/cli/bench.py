"""`uppm bench fusion`: time a frame against Open3D in the same run, and while the map grows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

bench_app = typer.Typer(help="Measure speed and memory on this machine (docs/performance.md).", no_args_is_help=True)
GRID_SIZES = 0.05, 0.03, 0.02
"""Metres, at which a grid of segments is fused where no size is asked for."""
ROWS = {
    "rules": lambda r: r["config"],
    "voxel size, cm": lambda r: "size priors" if r["voxel_size"] is None else f"{100 * r['voxel_size']:g}",
    "segments": lambda r: r["segments"],
    "frames x repeats": lambda r: f"{r['frames']} x {r['repeats']}",
    "ms a frame, median": lambda r: r["ms_per_frame_median"],
    "ms a frame, mean": lambda r: r["ms_per_frame_mean"],
    "ms a frame, 90 %": lambda r: r["ms_per_frame_p90"],
    "ms a frame, least median of the repeats": lambda r: r["ms_per_frame_median_min"],
    "ms a frame, median of each frame's least": lambda r: r["ms_per_frame_median_of_least"],
    "ms of processor time a frame, all threads": lambda r: r["cpu_ms_per_frame_median"],
    "Open3D, geometry only: median": lambda r: r["open3d_ms_per_frame_median"],
    "Open3D, least median": lambda r: r["open3d_ms_per_frame_median_min"],
    "Open3D, median of each frame's least": lambda r: r["open3d_ms_per_frame_median_of_least"],
    "Open3D, processor time": lambda r: r["open3d_cpu_ms_per_frame_median"],
    "ratio to Open3D": lambda r: r["ratio_open3d"],
    "ratio of the medians of the least": lambda r: r["ratio_open3d_least"],
    "ratio of the processor times": lambda r: r["ratio_open3d_cpu"],
    "first call, s": lambda r: r["first_call_s"],
    "blocks": lambda r: r["blocks"],
    "blocks a frame": lambda r: r["blocks_per_frame"],
    "Open3D, blocks a frame, voxels a side": lambda r: (
        r["open3d_blocks_per_frame"] and f"{r['open3d_blocks_per_frame']}, {r['open3d_block_resolution']}"
    ),
    "submaps": lambda r: r["submaps"],
    "bytes a voxel": lambda r: r["bytes_per_voxel"],
    "map, MB": lambda r: r["map_mb"],
    "process at its peak, MB": lambda r: r["peak_memory_mb"],
    "load before, after": lambda r: f"{r['load_before']}, {r['load_after']}",
}
"""Row of the table -> what stands in it."""


@bench_app.callback()
def bench() -> None:
    """Measure speed and memory on this machine (docs/performance.md)."""


@bench_app.command("fusion")
def bench_fusion_command(
    sequence: Annotated[list[Path], typer.Option(help="Posed RGB-D sequence; repeat it for more.")],
    voxel_size: Annotated[
        list[float] | None, typer.Option(min=0.005, help="Metres; absent: 5, 3, 2 cm for grid8, else size priors.")
    ] = None,
    segments: Annotated[
        Literal["auto", "grid8", "groundtruth"], typer.Option(help="What is fused; auto: groundtruth if there is some.")
    ] = "auto",
    config: Annotated[list[str] | None, typer.Option(help="uppm, paper, panmap or a YAML file; repeat it.")] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Use the first so many; a lap's with --curve.")] = None,
    repeat: Annotated[int, typer.Option(min=1, help="Runs of each case.")] = 1,
    curve: Annotated[int | None, typer.Option(min=2, metavar="LAPS", help="Go on over a growing map.")] = None,
    max_memory: Annotated[float | None, typer.Option(min=1, metavar="MB", help="With --curve: exit 1 beyond.")] = None,
    open3d: Annotated[bool, typer.Option(help="Measure Open3D in the same run.")] = True,
    set_: Annotated[list[str] | None, typer.Option("--set", help="One setting, as fusion.truncation=3.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: one object, or a list for several.")] = False,
) -> None:
    """Time of association, allocation and integration a frame; decoding and perception are outside the clock."""
    from uppm.bench.curve import growth_curve
    from uppm.bench.fusion import FusionCase, bench_fusion
    from uppm.core.config import Config
    from uppm.datasets.registry import open_sequence

    results: list[dict[str, Any]] = []
    for path in sequence:
        for name in config or ["uppm"]:
            settings = Config.load(name, set_ or ())
            source = open_sequence(path, settings.input)
            kind = segments if segments != "auto" else "groundtruth" if source.frame(0).truth else "grid8"
            for size in voxel_size or (GRID_SIZES if kind == "grid8" else [None]):
                case = FusionCase(
                    voxel_size=size, segments=kind, frames=frames, repeat=repeat, config=name, fusion=settings.fusion
                )
                found = growth_curve(source, case, curve) if curve else bench_fusion(source, case, open3d=open3d)
                results.append(found)
    if as_json:
        typer.echo(json.dumps(results if len(results) > 1 else results[0], indent=2))
    else:
        _print_curves(results) if curve else _print_table(results)
    if curve and max_memory and max(result["peak_memory_mb"] for result in results) > max_memory:
        raise typer.Exit(1)


@bench_app.command("perception")
def bench_perception_command(
    random_weights: Annotated[bool, typer.Option("--random-weights", help="Draw weights: times alone mean anything.")],
    profile: Annotated[str, typer.Option(help="Whose back ends are timed.")] = "foundation",
    frames: Annotated[int, typer.Option(min=1, help="Timed frames, after one that is not.")] = 3,
    labels: Annotated[int, typer.Option(min=1, help="Prompts of the detector.")] = 12,
    boxes: Annotated[int, typer.Option(min=1, help="Boxes of the mask generator.")] = 15,
    set_: Annotated[list[str] | None, typer.Option("--set", help="One setting, as perception.device=cpu.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Time of each stage of perception on this device, beside the paper's table; weights are random."""
    from uppm.bench.perception import PerceptionCase, bench_perception
    from uppm.core.config import Config

    if not random_weights:
        raise typer.BadParameter("only random weights are timed so far: say --random-weights")
    config = Config.load(overrides=[f"perception.profile={profile}", *(set_ or [])]).perception
    result = bench_perception(PerceptionCase(config=config, frames=frames, labels=labels, boxes=boxes))
    typer.echo(json.dumps(result, indent=2)) if as_json else _print_perception(result)


def _print_perception(result: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(
        "stage", "ms", "ms of processor time", "paper, A100", title=f"{result['profile']} on {result['device']}"
    )
    for stage, paper in result["paper_ms"].items():
        own = result["stages_ms"].get(stage, {"wall": "not timed", "cpu": ""})
        table.add_row(stage, str(own["wall"]), str(own["cpu"]), f"{paper:g}")
    table.add_section()
    table.add_row("sum", *(str(result["sum_ms"][c]) for c in ("wall", "cpu")), f"{sum(result['paper_ms'].values()):g}")
    Console().print(table)
    typer.echo(f"{result['note']}; load {result['load_before']} before, {result['load_after']} after")
    _print_machine(result)


def _print_table(results: list[dict[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("", *(Path(result["sequence"]).name for result in results))
    for name, cell in ROWS.items():
        table.add_row(name, *("-" if cell(r) is None else str(cell(r)) for r in results))
    table.add_section()
    for stage in results[0]["stages"]:
        table.add_row(f"{stage}, ms", *(str(result["stages"][stage]) for result in results))
    console = Console()
    console.print(table)
    _print_machine(results[0])
    for note in {result["note"] for result in results if result["note"]}:
        console.print(note, markup=False)


def _print_curves(results: list[dict[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table

    for result in results:
        table = Table("lap", "ms a frame", "blocks", "submaps", "process, MB", title=Path(result["sequence"]).name)
        rows = (result[f"lap_{key}"] for key in ("ms_per_frame_median", "blocks", "submaps", "memory_mb"))
        for lap, row in enumerate(zip(*rows, strict=True), start=1):
            table.add_row(str(lap), *map(str, row))
        Console().print(table)
        frames, peak, per_block = result["frames"], result["peak_memory_mb"], result["kb_per_block"]
        typer.echo(f"{frames} frames, at most {peak} MB; {per_block} kB a block from the first lap to the last")
        growth = f"{result['growth_ratio']} times the time ({result['growth_ratio_cpu']} of processor time)"
        typer.echo(
            f"one more lap in a map of {result['blocks_growth']} times the blocks, in turn with a small one: {growth}"
        )
    _print_machine(results[0])


def _print_machine(result: dict[str, Any]) -> None:
    typer.echo(", ".join(f"{name} {value}" for name, value in result["machine"].items()))
