"""Readers by name, and finding the one that knows a folder."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol, cast

from uppm.core.config import InputConfig
from uppm.core.errors import ConfigError, InputError
from uppm.datasets.sequence import PosedSequence, RawSequence

READERS = {
    "frames": "uppm.datasets.frames:Frames",
    "7scenes": "uppm.datasets.seven_scenes:SevenScenes",
    "hololens": "uppm.datasets.hololens:HoloLens",
    "tum": "uppm.datasets.tum:Tum",
    "replica": "uppm.datasets.replica:Replica",
    "scannet": "uppm.datasets.scannet:ScanNet",
    "3rscan": "uppm.datasets.three_rscan:ThreeRScan",
    "panmap-flat": "uppm.datasets.panmap_flat:PanmapFlat",
    "record3d": "uppm.datasets.record3d:Record3D",
    "video": "uppm.datasets.video:Video",
    "bag": "uppm.datasets.bags.reader:Bag",
}
"""Format -> reader; plug-ins add theirs under the entry-point group `uppm.readers`."""


class Reader(Protocol):
    """What a format's class offers."""

    looks_for: str
    """What `matches` looks for, for messages."""

    @staticmethod
    def matches(path: Path) -> bool:
        """Whether the path has this format's marks; cheap, reads no file."""
        ...

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        """The sequence, its frames not yet read; raises `InputError`.

        config: what the user said of topics, frames and times; conventions of poses and depth are applied later.
        """
        ...


def open_sequence(path: str | Path, config: InputConfig = InputConfig()) -> PosedSequence:  # noqa: B008 (frozen)
    """Open a posed RGB-D sequence; frames are read when asked for.

    Raises
    ------
    InputError
        There is no such path, no format fits, or what all frames share (intrinsics, counts, sizes) is wrong.
    ConfigError
        `config.format` names no reader.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, expected="a sequence's folder or file", found="nothing there", advice="check the path")
    reader = _named(config.format) if config.format else _found(path)
    return PosedSequence(reader.read(path, config), config)


def _load(target: str) -> Reader:
    module, _, name = target.partition(":")
    return cast(Reader, getattr(import_module(module), name))


def _plugins() -> dict[str, str]:
    return {entry.name: entry.value for entry in entry_points(group="uppm.readers")}


def _named(name: str) -> Reader:
    if name in READERS:
        return _load(READERS[name])
    plugins = _plugins()
    if name in plugins:
        return _load(plugins[name])
    known = ", ".join([*READERS, *plugins])
    raise ConfigError("input.format", expected=f"one of {known}", found=repr(name), advice="name one of these")


def _found(path: Path) -> Reader:
    readers = {name: _load(target) for name, target in (READERS | _plugins()).items()}
    for reader in readers.values():
        if reader.matches(path):
            return reader
    empty = path.is_dir() and not any(path.iterdir())
    formats = "; ".join(f"{name} ({reader.looks_for})" for name, reader in readers.items())
    found = "an empty folder" if empty else "none of their marks"
    advice = "give the folder that holds these, convert to the frames layout (docs/datasets.md) or name --format"
    raise InputError(path, expected=f"a sequence in one of the formats {formats}", found=found, advice=advice)
