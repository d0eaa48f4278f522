"""Colours as other programs have them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def linear_light(srgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Linear light, 0 to 1, of sRGB bytes (IEC 61966-2-1)."""
    c = srgb.astype(np.float32) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4).astype(np.float32)
