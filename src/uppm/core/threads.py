"""How many threads the stages take where they run at the same time."""

from __future__ import annotations

import os

from uppm.core.config import Config


def within_cores(config: Config) -> Config:
    """The configuration with no more threads than cores where perception runs ahead of fusion.

    Threads beyond the cores wait for each other's turns. Each stage keeps one at least, and its share of what was asked
    for; where the cores suffice, or the stages take turns, nothing changes.
    """
    wanted, cores = (config.perception.threads, config.fusion.threads), usable_cores()
    if not config.perception.ahead or sum(wanted) <= cores:
        return config
    perception = min(max(1, round(cores * wanted[0] / sum(wanted))), max(1, cores - 1))
    fusion = min(wanted[1], max(1, cores - perception))
    return config.model_copy(
        update={
            "perception": config.perception.model_copy(update={"threads": perception}),
            "fusion": config.fusion.model_copy(update={"threads": fusion}),
        }
    )


def usable_cores() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
