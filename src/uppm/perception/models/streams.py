"""The CUDA stream of perception that runs ahead of fusion; on a CPU there is none."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import torch


@contextmanager
def own_stream(device: torch.device, *, wanted: bool) -> Generator[None]:
    """Inside, what is computed on a CUDA device is queued apart from the default stream; it is done on leaving.

    Every network of a device takes the same stream: one stage needs what the last one found, and memory that one
    network frees is the next one's only within a stream.
    """
    if not wanted or device.type != "cuda":
        yield
        return
    import torch

    stream = _stream(device)
    with torch.cuda.stream(stream):
        yield
    stream.synchronize()


@cache
def _stream(device: torch.device) -> Any:
    import torch

    return torch.cuda.Stream(device)
