"""Identity over time: does an instance stay in the submap that it was put in?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError

MAIN_SHARE = 0.5
"""A frame puts an instance in a submap that holds more than this share of its labeled pixels."""


def frame_assignment(truth_ids: npt.NDArray[np.integer], submap_ids: npt.NDArray[np.integer]) -> dict[int, int]:
    """True instance -> the submap that more than half of its pixels went to, of one frame.

    Parameters
    ----------
    truth_ids, submap_ids : (H, W), 0: none. Pixels without a submap do not count; instances without a majority are
        left out.
    """
    if truth_ids.shape != submap_ids.shape:
        found = f"{submap_ids.shape}"
        raise InputError(
            "submap image", expected=f"{truth_ids.shape}", found=found, advice="compare frames of one size"
        )
    both = (truth_ids > 0) & (submap_ids > 0)
    pairs, counts = np.unique(np.stack([truth_ids[both], submap_ids[both]]), axis=1, return_counts=True)
    instances, inverse = np.unique(pairs[0], return_inverse=True)
    total = np.bincount(inverse, weights=counts, minlength=len(instances))
    main = counts > MAIN_SHARE * total[inverse]
    return dict(zip(pairs[0][main].tolist(), pairs[1][main].tolist(), strict=True))


def id_switches(frames: Iterable[Mapping[int, int]]) -> int:
    """Times that an instance is found in another submap than when it was last found (as in CLEAR MOT)."""
    last: dict[int, int] = {}
    switches = 0
    for assignment in frames:
        switches += sum(last.get(instance, submap) != submap for instance, submap in assignment.items())
        last.update(assignment)
    return switches
