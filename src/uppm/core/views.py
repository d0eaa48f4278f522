"""What a camera sees of a map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.types import Intrinsics
from uppm.core.validation import check_array


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedView:
    """Four images of a map from one place; 0 where no surface is seen."""

    color: npt.NDArray[np.uint8]
    """(H, W, 3), RGB."""
    depth: npt.NDArray[np.float32]
    """(H, W), metres along the optical axis."""
    instance: npt.NDArray[np.int32]
    """(H, W), submap ids; the unlabeled background has its own."""
    category: npt.NDArray[np.int32]
    """(H, W), unified category ids; 0: the unlabeled background too."""
    T_map_camera: npt.NDArray[np.float64]
    """(4, 4)."""
    intrinsics: Intrinsics

    def __post_init__(self) -> None:
        shape = (self.intrinsics.height, self.intrinsics.width)
        check_array("rendered colour", self.color, dtype=np.uint8, shape=(*shape, 3))
        check_array("rendered depth", self.depth, dtype=np.float32, shape=shape)
        check_array("rendered instances", self.instance, dtype=np.int32, shape=shape)
        check_array("rendered categories", self.category, dtype=np.int32, shape=shape)
