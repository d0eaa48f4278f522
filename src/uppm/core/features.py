"""How things look, as vectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.validation import check_array


@dataclass(frozen=True, kw_only=True, eq=False)
class VisualFeature:
    """How a submap looked, on average: beside its labels, for comparison with pictures or with words."""

    mean: npt.NDArray[np.float32]
    """(D,) mean of its observations' unit vectors; not of unit length itself."""
    count: int
    """Observations."""

    def __post_init__(self) -> None:
        check_array("visual feature", self.mean, dtype=np.float32, shape=(None,))
