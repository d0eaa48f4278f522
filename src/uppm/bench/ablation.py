"""What each part of the fusion brings: a sequence mapped with ground-truth segments, one setting changed at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.bench.timing import Clock, figures, load, machine
from uppm.core.config import Config
from uppm.core.protocols import FrameSource
from uppm.core.types import VOXELS_PER_SIDE, DescribedSegmentation, Frame
from uppm.datasets.registry import open_sequence
from uppm.evaluation.ground_truth import SurfaceTruth, load_surface_truth
from uppm.evaluation.map_evaluation import evaluate_map
from uppm.map.panoptic_map import PanopticMap
from uppm.pipeline import Mapper, good_frames
from uppm.regimes import map_reconstruction

BYTES_PER_VOXEL = 11
VARIANTS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "uppm": ("uppm", ()),
    "one voxel size, 2 cm": ("uppm", ("fusion.voxel_size=0.02", "fusion.unlabeled_voxel_size=0.02")),
    "one voxel size, 3 cm": ("uppm", ("fusion.voxel_size=0.03", "fusion.unlabeled_voxel_size=0.03")),
    "one voxel size, 5 cm": ("uppm", ("fusion.voxel_size=0.05", "fusion.unlabeled_voxel_size=0.05")),
    "no belonging counters": ("uppm", ("fusion.belonging=once",)),
    "no interpolation": ("uppm", ("fusion.interpolation=nearest",)),
    "distance along the ray": ("uppm", ("fusion.distance=ray",)),
    "all blocks in view": ("uppm", ("fusion.update=view",)),
    "constant noise": ("uppm", ("fusion.noise=constant",)),
    "panmap": ("panmap", ()),
}
"""Name -> preset, and the settings in which the variant differs from it."""


def ablation(sequence: Path, variants: Sequence[str] = (), overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Map the sequence in each variant and measure it against the sequence's surface.

    Parameters
    ----------
    sequence : Path
        With ground-truth segments, and `surface.npz`.
    variants : names of `VARIANTS`
        None given: all.
    overrides : settings of all variants
        As `input.depth_noise=structured-light`.

    Raises
    ------
    InputError
        The sequence cannot be read, or has no ground truth.
    """
    before, truth = load(), load_surface_truth(sequence)
    rows: list[dict[str, Any]] = []
    for name in variants or VARIANTS:
        preset, changes = VARIANTS[name]
        config = Config.load(preset, ["perception.profile=groundtruth", *changes, *overrides])
        rows.append({"variant": name, **_measured(open_sequence(sequence, config.input), config, truth)})
    return {"rows": rows, "machine": {**machine(), "load_before": before, "load_after": load()}}


def _measured(source: FrameSource, config: Config, truth: SurfaceTruth) -> dict[str, Any]:
    mapper, clock = Mapper(config), Clock()
    fuse = mapper._fusion.fuse

    def clocked(frame: Frame, segmentation: DescribedSegmentation) -> npt.NDArray[np.int32]:
        with clock.frame():
            return fuse(frame, segmentation)

    mapper._fusion.fuse = clocked
    for frame in good_frames(source):
        mapper.integrate(frame)
    mapper.finish()
    found, times = mapper.map, figures([clock])
    # Without voxels, which only the errors of Panoptic Multi-TSDFs' own evaluation ask for.
    metrics = evaluate_map(replace(map_reconstruction(found, source.name), layers=()), truth).to_dict()
    blocks = _blocks(found)
    return {
        "frames": len(clock.seconds),
        **{name: metrics[name] for name in ("accuracy_cm", "completeness_cm", "completion_ratio_5cm")},
        **{name: metrics[name] for name in ("one_submap_ratio", "one_submap_ratio_things")},
        "submaps": len(found.submaps),
        "blocks": blocks,
        "map_mb": round(blocks * VOXELS_PER_SIDE**3 * BYTES_PER_VOXEL / 1e6, 1),
        **{name: times[name] for name in ("ms_per_frame_median", "cpu_ms_per_frame_median")},
    }


def _blocks(found: PanopticMap) -> int:
    return sum(len(found.blocks(submap.id)) for submap in found.submaps)
