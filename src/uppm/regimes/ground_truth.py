"""The ground truth of a sequence, cut to what its cameras saw."""

from __future__ import annotations

from pathlib import Path

from uppm.core.errors import InputError
from uppm.datasets.registry import open_sequence
from uppm.evaluation.ground_truth import SurfaceTruth, load_surface_truth
from uppm.evaluation.observed import observe
from uppm.pipeline import good_frames


def open_truth(path: Path, frames: Path | None = None) -> SurfaceTruth:
    """Read ground truth; a whole scan is cut to what the frames saw, where there are frames.

    Parameters
    ----------
    path : the sequence or scan.
    frames : its frames, if they are elsewhere.

    Raises
    ------
    InputError
        There is no ground truth, or it is damaged, or the frames saw nothing of it.
    """
    truth = load_surface_truth(path)
    if truth.is_observed:
        return truth
    try:
        source = open_sequence(frames or path)
    except InputError:
        if frames is not None:
            raise
        # A scan without frames: the evaluation says that it is whole.
        return truth
    seen = observe(truth, good_frames(source))
    if not len(seen.points):
        advice = "are scan and poses in one frame? see `uppm check`"
        raise InputError(path, expected="a scan that the frames saw", found="no point of it seen", advice=advice)
    return seen
