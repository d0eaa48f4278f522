"""The input of SAM 2 and SAM 3, whose own processors ask for torchvision: resized to a square, normalised."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def square_input(
    color: npt.NDArray[np.uint8], side: int, mean: tuple[float, ...], std: tuple[float, ...]
) -> npt.NDArray[np.float32]:
    """Pixel values (1, 3, side, side) of an RGB image (H, W, 3), aspect ratio not kept.

    As torchvision does for 8-bit images: bilinear with anti-aliasing, rounded to 8 bits, then normalised.
    """
    import torch

    image = torch.from_numpy(np.ascontiguousarray(color)).permute(2, 0, 1)[None].float()
    resized: Any = torch.nn.functional.interpolate(image, (side, side), mode="bilinear", antialias=True)
    pixels = resized.round().clamp(0, 255).numpy() / np.float32(255)
    center, spread = (np.array(values, dtype=np.float32)[:, None, None] for values in (mean, std))
    return (pixels - center) / spread
