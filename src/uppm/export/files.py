"""Files written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError


def write_bytes(path: Path | str, data: bytes) -> None:
    """Write beside the file, then take its place; the folder must exist.

    Raises
    ------
    InputError
        The folder is missing, `path` is a folder, or the disk is full; an older file then stays as it was.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(path.parent, expected="a folder", found="nothing there", advice="make it or name another")
    if path.is_dir():
        raise InputError(path, expected="a file name", found="a folder", advice="add a name")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        found = error.strerror or str(error)
        raise InputError(
            path, expected="room for the file", found=found, advice="free space or write elsewhere"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path | str, content: Mapping[str, Any]) -> None:
    """Write a JSON document, indented; NaN is refused, as other readers would refuse it."""
    write_bytes(path, (json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())


def write_png(path: Path | str, image: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> None:
    """Write an RGB image (H, W, 3), or one channel (H, W), of 8 or 16 bits."""
    import cv2

    encoded = cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image))[1]
    write_bytes(path, encoded.tobytes())
