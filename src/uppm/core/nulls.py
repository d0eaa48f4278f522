"""Stand-ins that do nothing, and the timer: what a `Mapper` uses where nothing else was given."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

from uppm.core.config import PerceptionConfig
from uppm.core.language import Caption
from uppm.core.shown import Content
from uppm.core.types import Frame


class NoCaptioner:
    """The captioner of the front ends whose segmenter brings its own vocabulary."""

    def __init__(self, config: PerceptionConfig) -> None: ...

    def caption(self, frame: Frame) -> Caption:
        """Nothing said."""
        return Caption()


class NoViewer:
    """Shows nothing."""

    def show(self, frame: Frame, submap_ids: npt.NDArray[np.int32], content: Callable[[float], Content]) -> None:
        """Do nothing."""


class Timer:
    """Seconds by stage."""

    def __init__(self, seconds: Mapping[str, float] | None = None) -> None:
        self.seconds = dict(seconds or {})

    @contextmanager
    def __call__(self, stage: str) -> Generator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start

    def add(self, seconds: Mapping[str, float]) -> None:
        """Take over what was timed elsewhere."""
        for stage, value in seconds.items():
            self.seconds[stage] = self.seconds.get(stage, 0.0) + value
