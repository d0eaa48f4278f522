"""Segmentation-to-Map: the same fusion fed by different front ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.config import Config
from uppm.core.protocols import FrameSource
from uppm.core.shown import Content
from uppm.core.types import Frame
from uppm.evaluation.ground_truth import SurfaceTruth
from uppm.evaluation.instances import MIN_PIXELS
from uppm.evaluation.map_evaluation import Comparison, compare, measure
from uppm.evaluation.tracks import frame_assignment, id_switches
from uppm.pipeline import map_sequence
from uppm.regimes.reconstructions import open_reconstruction

STAGES = ("labels", "perception", "retrieval", "fusion")
"""What counts as time of a frame; decoding and the map file do not."""


class IdentityTracks:
    """A viewer that notes which submap each true instance went to, frame by frame."""

    def __init__(self) -> None:
        self.frames: list[dict[int, int]] = []

    def show(self, frame: Frame, submap_ids: npt.NDArray[np.int32], content: Callable[[float], Content]) -> None:
        """Note one frame that has ground truth."""
        if frame.truth is not None:
            self.frames.append(frame_assignment(frame.truth.instance, submap_ids))


def evaluate_front_end(
    source: FrameSource,
    truth: SurfaceTruth,
    config: Config,
    map_file: Path,
    *,
    points_per_m2: float = 10_000,
    seed: int = 0,
    min_pixels: int = MIN_PIXELS,
) -> tuple[dict[str, Any], Comparison]:
    """Map a sequence with `config` into `map_file`, replacing it, and measure the map.

    Returns
    -------
    The figures of `MapEvaluation`, with `perception`, `frames`, `frames_per_second`, `id_switches` and `seconds`; and
    the comparison that pictures are drawn of.
    """
    tracks = IdentityTracks()
    run = map_sequence(source, map_file, config, overwrite=True, viewer=tracks)
    reconstruction = open_reconstruction(map_file)
    comparison = compare(reconstruction, truth, points_per_m2=points_per_m2, seed=seed)
    found = measure(comparison, min_pixels).to_dict()
    switches = id_switches(tracks.frames) if tracks.frames else None
    return found | {
        "perception": config.perception.profile,
        "id_switches": switches,
        **speed(run.seconds, run.frames),
    }, comparison


def speed(seconds: Mapping[str, float], frames: int) -> dict[str, Any]:
    """`frames`, how many of them a second, and the seconds by stage."""
    total = sum(seconds.get(stage, 0.0) for stage in STAGES)
    return {
        "frames": frames,
        "frames_per_second": frames / total if total else None,
        "seconds": {stage: round(s, 3) for stage, s in seconds.items()},
    }
