"""Unified promptable panoptic mapping: posed RGB-D in, a multi-resolution TSDF map that knows what things are out."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uppm.core.config import Config as Config
    from uppm.core.errors import InputError as InputError
    from uppm.core.errors import UppmError as UppmError
    from uppm.core.types import Frame as Frame
    from uppm.core.types import Intrinsics as Intrinsics
    from uppm.datasets.registry import open_sequence as open_sequence
    from uppm.live import LiveMapper as LiveMapper
    from uppm.live import LiveStatistics as LiveStatistics
    from uppm.map.panoptic_map import PanopticMap as PanopticMap
    from uppm.pipeline import Mapper as Mapper
    from uppm.pipeline import map_sequence as map_sequence
    from uppm.pipeline import open_map as open_map

_EXPORTS = {
    "Config": "uppm.core.config",
    "Frame": "uppm.core.types",
    "InputError": "uppm.core.errors",
    "Intrinsics": "uppm.core.types",
    "LiveMapper": "uppm.live",
    "LiveStatistics": "uppm.live",
    "Mapper": "uppm.pipeline",
    "PanopticMap": "uppm.map.panoptic_map",
    "UppmError": "uppm.core.errors",
    "map_sequence": "uppm.pipeline",
    "open_map": "uppm.pipeline",
    "open_sequence": "uppm.datasets.registry",
}

__all__ = sorted(_EXPORTS)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that `import uppm` is quick."""
    if name not in _EXPORTS:
        raise AttributeError(f"module 'uppm' has no attribute {name!r}")
    return getattr(import_module(_EXPORTS[name]), name)


def __dir__() -> list[str]:
    return __all__
