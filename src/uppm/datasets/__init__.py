"""Posed RGB-D sequences on disk -> frames; one reader a file."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uppm.datasets.check import Finding, SequenceCheck, check_sequence
    from uppm.datasets.frames import truth_surface
    from uppm.datasets.registration import register_depth
    from uppm.datasets.registry import open_sequence
    from uppm.datasets.sequence import PosedSequence, RawFrame, RawSequence

_HOMES = {
    "open_sequence": "registry",
    "PosedSequence": "sequence",
    "RawFrame": "sequence",
    "RawSequence": "sequence",
    "truth_surface": "frames",
    "register_depth": "registration",
    "check_sequence": "check",
    "SequenceCheck": "check",
    "Finding": "check",
}

__all__ = [
    "Finding",
    "PosedSequence",
    "RawFrame",
    "RawSequence",
    "SequenceCheck",
    "check_sequence",
    "open_sequence",
    "register_depth",
    "truth_surface",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
