"""The package's errors: one base, one line each, with advice."""

from __future__ import annotations

from collections.abc import Mapping
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


def nothing_usable(source: str, skipped: Mapping[str, int], advice: str) -> InputError:
    """The error of a sequence without a frame that can be mapped; skipped: reason -> frames."""
    found = ", ".join(f"{count} with {reason}" for reason, count in skipped.items()) or "none"
    return InputError(source, expected="frames that can be used", found=found, advice=advice)
