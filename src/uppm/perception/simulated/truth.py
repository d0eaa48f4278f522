"""The ground truth that the simulation starts from."""

from __future__ import annotations

from uppm.core.errors import InputError
from uppm.core.types import Frame, GroundTruth


def ground_truth(frame: Frame) -> GroundTruth:
    """A frame's ground truth; raises `InputError` where the sequence has none."""
    if frame.truth is None:
        advice = "simulate on a sequence with instance/ and labels.csv, or choose another --perception"
        raise InputError(f"frame {frame.index}", expected="ground truth", found="none", advice=advice)
    return frame.truth
