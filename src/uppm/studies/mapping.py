"""Map a sequence for a study: in memory, its segments measured on the way, perception shared by the study's runs."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from uppm.core.config import Config
from uppm.core.errors import BadFrameError
from uppm.core.language import FrameLabels
from uppm.core.parallel import run_ahead
from uppm.core.protocols import Labeler, Segmenter
from uppm.core.types import Frame, Label, PanopticSegmentation
from uppm.datasets.registry import open_sequence
from uppm.evaluation.ground_truth import load_instances
from uppm.evaluation.image_panoptic import frame_overlaps
from uppm.evaluation.panoptic_metrics import PanopticMetrics, panoptic_metrics
from uppm.perception.front_end import Percept, spread_frames
from uppm.perception.registry import create_labeler, create_segmenter, seen_by_camera
from uppm.pipeline import Mapper


@dataclass(eq=False)
class Seen:
    """What the labeler and the segmenter of one perception said of each frame of a sequence, by `Frame.index`."""

    labels: dict[int, FrameLabels] = field(default_factory=dict[int, FrameLabels])
    segments: dict[int, tuple[bytes, PanopticSegmentation]] = field(
        default_factory=dict[int, tuple[bytes, PanopticSegmentation]]
    )
    """The id image, compressed, and the rest."""


class SharedPerception:
    """What was seen with each setting of perception, for the runs of a study that differ in something else."""

    def __init__(self) -> None:
        self._seen: dict[str, Seen] = {}

    def of(self, sequence: Path, config: Config) -> tuple[Labeler, Segmenter]:
        """Back ends that ask those of the configuration once a frame."""
        key = f"{sequence} {config.input.model_dump_json()} {config.perception.model_dump_json()}"
        seen = self._seen.setdefault(key, Seen())
        return SeenLabels(create_labeler(config.perception), seen), SeenSegments(
            create_segmenter(config.perception), seen
        )


class SeenLabels:
    """A labeler that looks at each frame once in a study."""

    def __init__(self, labeler: Labeler, seen: Seen) -> None:
        self._labeler, self._seen = labeler, seen

    def label(self, frame: Frame) -> FrameLabels:
        """What was said of the frame, now or before."""
        if frame.index not in self._seen.labels:
            self._seen.labels[frame.index] = self._labeler.label(frame)
        return self._seen.labels[frame.index]


class SeenSegments:
    """Likewise, a segmenter. It is given the same labels for a frame each time, since perception knows no map."""

    def __init__(self, segmenter: Segmenter, seen: Seen) -> None:
        self._segmenter, self._seen = segmenter, seen

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Look at a few frames spread over the sequence."""
        self._segmenter.prepare(frames)

    def segment(self, frame: Frame, labels: Sequence[Label]) -> PanopticSegmentation:
        """What was found in the frame, now or before."""
        if frame.index not in self._seen.segments:
            found = self._segmenter.segment(frame, labels)
            nothing = np.zeros((0, 0), dtype=np.int32)
            self._seen.segments[frame.index] = zlib.compress(found.ids.tobytes(), 1), replace(found, ids=nothing)
            return found
        packed, rest = self._seen.segments[frame.index]
        ids = np.frombuffer(bytearray(zlib.decompress(packed)), dtype=np.int32).reshape(frame.depth.shape)
        return replace(rest, ids=ids)


def map_and_segments(sequence: Path, config: Config, shared: SharedPerception) -> tuple[Mapper, PanopticMetrics]:
    """The finished mapper of a sequence, and how good the segments were that it was given."""
    source, truth = open_sequence(sequence, config.input), load_instances(sequence)
    labeler, segmenter = shared.of(sequence, config)
    mapper = Mapper(config, labeler=labeler, segmenter=segmenter)
    mapper.prepare(spread_frames(source))
    seen, tables = seen_by_camera(source, config.perception), []

    def perceive(position: int) -> tuple[Frame, Percept]:
        frame = seen.frame(position)
        return frame, mapper.front_end.perceive(frame)

    with closing(mapper):
        for position, result in run_ahead(perceive, range(len(seen)), ahead=config.perception.ahead):
            try:
                frame, percept = result()
            except BadFrameError as error:
                mapper.skip(seen.indices[position], error.found)
                continue
            mapper.fuse(frame, percept)
            if frame.truth is not None and percept.segmentation is not None:
                tables.append(frame_overlaps(frame.truth.instance, truth, percept.segmentation))
        mapper.finish()
    return mapper, panoptic_metrics(tables)
