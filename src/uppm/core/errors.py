"""The package's errors: one base, one line each, with advice."""

from __future__ import annotations

from pathlib import Path


class UppmError(Exception):
    """Base of every error that the package raises on purpose."""


class InputError(UppmError, ValueError):
    """Input that cannot be used: which file, what was expected, what was found, what to do.

    Parameters
    ----------
    source : path or str
        The file, folder or argument at fault.
    expected, found, advice : str
        One clause each, without a final full stop.
    """

    def __init__(self, source: str | Path, *, expected: str, found: str, advice: str) -> None:
        self.source, self.expected, self.found, self.advice = str(source), expected, found, advice
        super().__init__(f"{source}: expected {expected}, found {found}; {advice}")


class BadFrameError(InputError):
    """One frame of a sequence that cannot be used; the others may be."""


class ConfigError(InputError):
    """A setting that is unknown, of the wrong type or out of range."""


class MapFileError(InputError):
    """A map file that cannot be read or written."""


class MissingExtraError(UppmError, ImportError):
    """An optional dependency is not installed."""

    def __init__(self, what: str, command: str) -> None:
        super().__init__(f"{what} is not installed; run: {command}")
