"""The fusion's time a frame, by stage, against Open3D's VoxelBlockGrid in the same run (docs/performance.md)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numba
import numpy as np
import numpy.typing as npt
from numba.np.ufunc.parallel import threading_layer

from uppm.bench.open3d_grid import Open3dGrid, fastest_resolution, load_open3d
from uppm.bench.segments import Segments, segments_of, settings_for
from uppm.bench.timing import Clock, Timed, figures, load, machine, resident_mb
from uppm.core.config import FusionConfig
from uppm.core.errors import MissingExtraError
from uppm.core.protocols import FrameSource
from uppm.core.types import VOXELS_PER_SIDE, DescribedSegmentation, Frame
from uppm.fusion.engine import PanopticFusion
from uppm.fusion.view import ViewFactory
from uppm.fusion.volume import Volume
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.pipeline import category_similarity

CHUNK = 10
"""Frames that one system fuses before the other has its turn; more than the caches hold."""
OPEN3D_VOXEL_SIZE = 0.03
"""Metres, where ours follows the categories' size priors."""
VOLUME_STAGES = {
    "visible": "cull",
    "overlap": "render",
    "expected": "misses",
    "place": "allocate",
    "integrate": "integrate",
}
"""Method of `Volume` -> stage."""
STAGES = ("view", "cull", "render", "misses", "allocate", "integrate", "other")


@dataclass(frozen=True, kw_only=True)
class FusionCase:
    """What is measured."""

    voxel_size: float | None
    """Metres; None: the categories' size priors."""
    segments: str
    """`grid8` or `groundtruth`."""
    frames: int | None = None
    """At most so many; None: all."""
    repeat: int = 1
    """Runs over the frames, each with a new map."""
    config: str = "uppm"
    """Name of the settings, for the table."""
    fusion: FusionConfig = field(default_factory=FusionConfig)

    @property
    def settings(self) -> FusionConfig:
        """The fusion's settings for this case, on all cores as Open3D takes them."""
        update: dict[str, Any] = {"voxel_size": self.voxel_size, "threads": numba.get_num_threads()}
        if self.voxel_size:
            update["unlabeled_voxel_size"] = self.voxel_size
        return settings_for(self.segments, self.fusion.model_copy(update=update))


class TimedVolume(Timed):
    """A volume's stages, and how many blocks each frame is integrated into."""

    def __init__(self, volume: Volume) -> None:
        super().__init__(volume, VOLUME_STAGES)
        self.integrated: list[int] = []

    def integrate(self, view: Any, blocks: npt.NDArray[np.int32], *args: Any) -> None:
        """As `Volume.integrate`."""
        self.integrated.append(len(blocks))
        self.__getattr__("integrate")(view, blocks, *args)


class TimedFusion:
    """Our fusion with a clock on each stage, put on from outside."""

    def __init__(self, settings: FusionConfig, similarity: npt.NDArray[np.float32]) -> None:
        self.fusion = PanopticFusion(settings, similarity)
        self.volume = TimedVolume(self.fusion._volume)
        self._views = Timed(self.fusion._views, {"view": "view"})
        self.fusion._volume = cast(Volume, self.volume)
        self.fusion._views = cast(ViewFactory, self._views)
        self.clock = Clock()
        self.stages: list[dict[str, float]] = []
        """Seconds of each frame by stage."""

    def fuse(self, frame: Frame, segmentation: DescribedSegmentation) -> None:
        """Fuse one frame."""
        with self.clock.frame():
            self.fusion.fuse(frame, segmentation)
        stages = self._views.take() | self.volume.take()
        self.stages.append({**stages, "other": self.clock.seconds[-1] - sum(stages.values())})

    @property
    def blocks(self) -> int:
        """Blocks in use."""
        return self.volume.pool.used

    @property
    def bytes_per_voxel(self) -> float:
        """Of all that the pool keeps for a block."""
        pool = self.volume.pool
        arrays = [a for a in vars(pool).values() if isinstance(a, np.ndarray) and len(a) == pool.capacity]
        return sum(a.nbytes for a in arrays) / pool.capacity / VOXELS_PER_SIDE**3


def chunks(
    source: FrameSource, segments: Segments, frames: int | None
) -> Iterator[list[tuple[Frame, DescribedSegmentation]]]:
    """Decoded frames with their segments, a few at a time."""
    positions = range(len(source))[:frames]
    for first in range(0, len(positions), CHUNK):
        decoded = [source.frame(p) for p in positions[first : first + CHUNK]]
        yield [(frame, segments(frame)) for frame in decoded]


def bench_fusion(source: FrameSource, case: FusionCase, *, open3d: bool = True) -> dict[str, Any]:
    """Measure one case; decoding and segmentation are outside the clock.

    The two systems take turns of `CHUNK` frames, and take turns in beginning, so that what else the machine does
    hits both alike.

    Parameters
    ----------
    open3d : bool
        Measure Open3D too; where it is not installed its keys are None and `note` says how to get it.
    """
    before, segments, similarity = load(), segments_of(case.segments), category_similarity(LabelEmbeddings())
    first_call = _first_call(source, case, segments, similarity)
    # Only now: Open3D brings a thread library along that Numba would take instead of its own.
    module, note = _open3d(open3d)
    resolution = _resolution(module, source, case) if module else None
    ours, theirs, peak = [], [], 0.0
    for _ in range(case.repeat):
        mine = TimedFusion(case.settings, similarity)
        grid = Open3dGrid(module, *_open3d_settings(case), resolution) if module and resolution else None
        peak = max(peak, _run(source, segments, case.frames, mine, grid))
        ours.append(mine)
        theirs.extend([grid] if grid else [])
    times = figures([run.clock for run in ours])
    return {
        "sequence": source.name,
        "config": case.config,
        "voxel_size": case.voxel_size,
        "segments": case.segments,
        "frames": len(ours[0].clock.seconds),
        "repeats": case.repeat,
        **times,
        **_theirs(theirs, times),
        **_inside(ours),
        "first_call_s": round(first_call, 3),
        "peak_memory_mb": round(peak, 1),
        "threads": case.settings.threads,
        "threading_layer": threading_layer(),
        "machine": machine(),
        "load_before": before,
        "load_after": load(),
        "note": note,
    }


def _first_call(
    source: FrameSource, case: FusionCase, segments: Segments, similarity: npt.NDArray[np.float32]
) -> float:
    """Seconds of the first two frames: the second is the first that looks at what is there."""
    timed = TimedFusion(case.settings, similarity)
    for position in range(min(2, len(source))):
        frame = source.frame(position)
        timed.fuse(frame, segments(frame))
    return sum(timed.clock.seconds)


def _open3d(wanted: bool) -> tuple[Any, str | None]:
    if not wanted:
        return None, None
    try:
        return load_open3d(), None
    except MissingExtraError as error:
        return None, str(error)


def _open3d_settings(case: FusionCase) -> tuple[float, float, float]:
    return case.voxel_size or OPEN3D_VOXEL_SIZE, case.settings.truncation, case.settings.depth_max


def _resolution(module: Any, source: FrameSource, case: FusionCase) -> int:
    count = min(CHUNK, len(source), case.frames or CHUNK)
    return fastest_resolution(module, [source.frame(p) for p in range(count)], *_open3d_settings(case))


def _run(
    source: FrameSource, segments: Segments, frames: int | None, mine: TimedFusion, grid: Open3dGrid | None
) -> float:
    """Give both systems all frames in turns; returns the memory's peak, MB."""
    peak = 0.0
    for number, chunk in enumerate(chunks(source, segments, frames)):
        if grid and number % 2:
            _fuse_geometry(grid, chunk)
        for frame, segmentation in chunk:
            mine.fuse(frame, segmentation)
        if grid and not number % 2:
            _fuse_geometry(grid, chunk)
        peak = max(peak, resident_mb())
    return peak


def _fuse_geometry(grid: Open3dGrid, chunk: Sequence[tuple[Frame, DescribedSegmentation]]) -> None:
    for frame, _ in chunk:
        grid.fuse(frame)


def _inside(runs: Sequence[TimedFusion]) -> dict[str, Any]:
    """Where the time and the memory go."""
    stages = [frame for run in runs for frame in run.stages]
    last = runs[-1]
    return {
        "stages": {
            name: round(float(np.median([stage.get(name, 0.0) for stage in stages])) * 1e3, 3) for name in STAGES
        },
        "blocks": last.blocks,
        "blocks_per_frame": int(np.median(last.volume.integrated)),
        "submaps": len(last.fusion.submaps()),
        "bytes_per_voxel": round(last.bytes_per_voxel, 2),
        "map_mb": round(last.blocks * VOXELS_PER_SIDE**3 * last.bytes_per_voxel / 1e6, 1),
    }


def _theirs(grids: Sequence[Open3dGrid], ours: Mapping[str, float]) -> dict[str, Any]:
    """Open3D's figures and ours as a multiple of them; None each where it was not measured."""
    found = figures([grid.clock for grid in grids]) if grids else dict.fromkeys(ours)
    ratios = {name: round(ours[name] / value, 3) if value else None for name, value in found.items()}
    return {
        **{f"open3d_{name}": value for name, value in found.items()},
        "ratio_open3d": ratios["ms_per_frame_median"],
        "ratio_open3d_least": ratios["ms_per_frame_median_of_least"],
        "ratio_open3d_cpu": ratios["cpu_ms_per_frame_median"],
        "open3d_block_resolution": grids[-1].resolution if grids else None,
        "open3d_blocks": grids[-1].blocks if grids else None,
        "open3d_blocks_per_frame": int(np.median(grids[-1].integrated)) if grids else None,
    }
