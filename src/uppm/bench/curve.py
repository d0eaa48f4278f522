"""Time a frame while the map grows: cost should follow what is in view, not what is in the map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from uppm.bench.fusion import FusionCase, TimedFusion, chunks
from uppm.bench.segments import Segments, segments_of
from uppm.bench.timing import Clock, load, machine, resident_mb
from uppm.core.protocols import FrameSource
from uppm.core.types import VOXELS_PER_SIDE, Frame
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.pipeline import category_similarity

TOTAL_FRAMES, MAX_FRAMES = 600, 5000
"""Of all laps together: where no number is asked for, and at most."""
GAP = 14.4
"""Metres between the same place in two laps: depth ends at 5 m, so that no lap sees another; whole blocks of 2, 3, 5
and 30 cm, so that all cut their surfaces alike."""


def growth_curve(source: FrameSource, case: FusionCase, laps: int) -> dict[str, Any]:
    """Fuse the sequence lap after lap, each beside the last, and time each.

    The laps are minutes apart, and the machine may be busier in one than in another. So how much the time grows is
    measured apart: one more lap, each frame fused in turn into a map of one lap and into the grown one.

    Parameters
    ----------
    case : FusionCase
        `frames` is the number a lap; None: the 600 of the whole curve shared out. `repeat` curves are run, and each
        frame's least time counts.
    """
    before, segments, similarity = load(), segments_of(case.segments), category_similarity(LabelEmbeddings())
    a_lap = min(case.frames or max(1, TOTAL_FRAMES // laps), MAX_FRAMES // laps, len(source))
    seconds, extents, ratios = [], [], []
    for _ in range(case.repeat):
        timed, small = TimedFusion(case.settings, similarity), TimedFusion(case.settings, similarity)
        for lap in range(laps):
            _fuse_lap(source, segments, a_lap, {lap: timed})
            extents.append((timed.blocks, len(timed.fusion.submaps()), round(resident_mb(), 1)))
        seconds.append(np.reshape(timed.clock.seconds, (laps, a_lap)))
        _fuse_lap(source, segments, a_lap, {0: small})
        _fuse_lap(source, segments, a_lap, {1: small, laps: timed})
        ratios.append(growth(small.clock, timed.clock, a_lap))
    ms = np.median(np.min(seconds, axis=0), axis=1) * 1e3
    blocks, submaps, memory = zip(*extents[-laps:], strict=True)
    return {
        "sequence": source.name,
        "config": case.config,
        "voxel_size": case.voxel_size,
        "segments": case.segments,
        "laps": laps,
        "frames_per_lap": a_lap,
        "repeats": case.repeat,
        "lap_ms_per_frame_median": [round(float(value), 3) for value in ms],
        "lap_blocks": list(blocks),
        "lap_submaps": list(submaps),
        "lap_memory_mb": list(memory),
        "frames": laps * a_lap,
        "peak_memory_mb": max(memory),
        "kb_per_block": round((memory[-1] - memory[0]) / max(1, blocks[-1] - blocks[0]) * 1e3, 2),
        "growth_ratio": round(float(np.median([wall for wall, _ in ratios])), 3),
        "growth_ratio_cpu": round(float(np.median([cpu for _, cpu in ratios])), 3),
        "blocks_growth": round(blocks[-1] / blocks[0], 2),
        "bytes_per_voxel": round(timed.bytes_per_voxel, 2),
        "map_mb": round(blocks[-1] * VOXELS_PER_SIDE**3 * timed.bytes_per_voxel / 1e6, 1),
        "machine": machine(),
        "load_before": before,
        "load_after": load(),
    }


def _fuse_lap(source: FrameSource, segments: Segments, a_lap: int, maps: Mapping[int, TimedFusion]) -> None:
    """Fuse the sequence into each map as the lap of that number, frame by frame in turn."""
    for chunk in chunks(source, segments, a_lap):
        for frame, segmentation in chunk:
            for lap, timed in maps.items():
                timed.fuse(_beside(frame, lap, a_lap), segmentation)


def growth(small: Clock, large: Clock, a_lap: int) -> tuple[float, float]:
    """Median time and processor time of the last lap, of the large map to the small."""
    pairs = (large.seconds, small.seconds), (large.cpu_seconds, small.cpu_seconds)
    wall, cpu = (float(np.median(a[-a_lap:]) / np.median(b[-a_lap:])) for a, b in pairs)
    return wall, cpu


def _beside(frame: Frame, lap: int, a_lap: int) -> Frame:
    """The frame as a camera sees it that many laps on; indices go on counting."""
    pose = frame.T_map_camera.copy()
    pose[0, 3] += lap * GAP
    return replace(frame, T_map_camera=pose, index=frame.index + lap * a_lap)
