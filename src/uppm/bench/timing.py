"""What a benchmark says of times, of the machine they were taken on, and of memory."""

from __future__ import annotations

import os
import platform
import resource
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

COPIED = 1 << 25
"""Values of 8 bytes that the bandwidth is measured with: far more than any cache holds."""


class Clock:
    """Time of each frame: what the wall clock says, and what all threads together spent on a core."""

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self.cpu_seconds: list[float] = []

    @contextmanager
    def frame(self) -> Iterator[None]:
        """Clock one frame."""
        start, cpu = time.perf_counter(), time.process_time()
        yield
        self.seconds.append(time.perf_counter() - start)
        self.cpu_seconds.append(time.process_time() - cpu)


class Timed:
    """Stands in for an object and adds up the seconds that its methods take, by stage.

    Parameters
    ----------
    target : object
    stages : mapping
        Method name -> stage; all else passes untimed.
    """

    def __init__(self, target: object, stages: Mapping[str, str]) -> None:
        self._target, self._stages = target, stages
        self.seconds: defaultdict[str, float] = defaultdict(float)
        """Stage -> seconds since the last `take`."""

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._target, name)
        return self._clocked(self._stages[name], found) if name in self._stages else found

    def _clocked(self, stage: str, method: Callable[..., Any]) -> Callable[..., Any]:
        def clocked(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            try:
                return method(*args, **kwargs)
            finally:
                self.seconds[stage] += time.perf_counter() - start

        return clocked

    def take(self) -> dict[str, float]:
        """Seconds by stage since the last call."""
        taken, self.seconds = dict(self.seconds), defaultdict(float)
        return taken


def figures(clocks: Sequence[Clock]) -> dict[str, float]:
    """What the times of the same frames, one clock a repeat, come to in ms.

    Median, mean and 90th percentile are over all. Other programs on the machine only ever add to them, so three more
    leave most of that out: the least of the repeats' medians, the median over the frames of each frame's least time,
    and the median of the processor time, all threads together.
    """
    ms = np.array([clock.seconds for clock in clocks]) * 1e3
    found = {
        "ms_per_frame_median": np.median(ms),
        "ms_per_frame_mean": ms.mean(),
        "ms_per_frame_p90": np.quantile(ms, 0.9),
        "ms_per_frame_median_min": np.median(ms, axis=1).min(),
        "ms_per_frame_median_of_least": np.median(ms.min(axis=0)),
        "cpu_ms_per_frame_median": np.median([clock.cpu_seconds for clock in clocks]) * 1e3,
    }
    return {name: round(float(value), 3) for name, value in found.items()}


def machine() -> dict[str, Any]:
    """The machine and the versions that the figures belong to."""
    packages = {name: _version(name) for name in ("uppm", "numpy", "numba", "open3d")}
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "copy_gb_per_s": round(copy_bandwidth(), 1),
        "omp_wait_policy": os.environ.get("OMP_WAIT_POLICY"),
        "python": platform.python_version(),
        **packages,
    }


def load() -> float | None:
    """Processes that wanted a core over the last minute; None where the system does not say."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def copy_bandwidth(repeats: int = 5) -> float:
    """Bytes read and written by a large NumPy copy on one core, GB/s; the best of several."""
    source, target = np.ones(COPIED), np.zeros(COPIED)
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        np.copyto(target, source)
        best = min(best, time.perf_counter() - start)
    return 2 * source.nbytes / best / 1e9


def resident_mb() -> float:
    """Memory of this process now, MB; its peak so far where the system does not tell."""
    statm = Path("/proc/self/statm")
    if statm.exists():
        return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return next(
        (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.processor()
    )


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
