"""Grids for navigation: ROS map_server's plan and costs, and distance fields as NumPy archives."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.export.files import write_bytes

FREE_SHADE, UNKNOWN_SHADE, OCCUPIED_SHADE = 254, 205, 0
"""Grey values that map_server's `trinary` mode reads as free, unknown and occupied with the thresholds below."""
UNKNOWN_COST = 255
"""What map_server's `raw` mode reads as unknown; costs are 0 to 100."""


def write_plan(
    path: Path | str, plan: npt.NDArray[np.int8], *, resolution: float, origin: tuple[float, float]
) -> list[Path]:
    """An occupancy plan (X, Y) of -1, 0 and 1 as NAME.yaml and NAME.pgm, as ROS's map_server loads it.

    origin: x, y of the lowest corner, metres. Returns the files. Raises `InputError` where they cannot be written.
    """
    shades = np.select([plan > 0, plan == 0], [OCCUPIED_SHADE, FREE_SHADE], UNKNOWN_SHADE).astype(np.uint8)
    return _write_image(path, shades, "trinary", resolution, origin)


def write_costs(
    path: Path | str, costs: npt.NDArray[np.uint8], *, resolution: float, origin: tuple[float, float]
) -> list[Path]:
    """Costs (X, Y) of 0 to 100, 255 where unknown, as NAME.yaml and NAME.pgm for map_server's `raw` mode."""
    return _write_image(path, costs, "raw", resolution, origin)


def write_arrays(path: Path | str, arrays: Mapping[str, npt.ArrayLike]) -> None:
    """Named arrays as a compressed `.npz`."""
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise InputError(path, expected="a name ending in .npz", found=repr(path.suffix), advice="name the file so")
    data = io.BytesIO()
    named: dict[str, Any] = {name: np.asarray(array) for name, array in arrays.items()}
    np.savez_compressed(data, **named)
    write_bytes(path, data.getvalue())


def _write_image(
    path: Path | str, cells: npt.NDArray[np.uint8], mode: str, resolution: float, origin: tuple[float, float]
) -> list[Path]:
    path = Path(path)
    if path.suffix.lower() not in (".yaml", ".yml"):
        found, advice = repr(path.suffix), "name the file so; the picture lies beside it as .pgm"
        raise InputError(path, expected="a name ending in .yaml", found=found, advice=advice)
    image = path.with_suffix(".pgm")
    # The picture's first row is the one with the greatest y.
    rows = np.ascontiguousarray(cells.T[::-1])
    write_bytes(image, b"P5\n%d %d\n255\n" % (rows.shape[1], rows.shape[0]) + rows.tobytes())
    text = (
        f"image: {image.name}\nmode: {mode}\nresolution: {resolution:g}\n"
        f"origin: [{origin[0]:.6g}, {origin[1]:.6g}, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    write_bytes(path, text.encode())
    return [path, image]
