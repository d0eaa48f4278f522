"""Folders that appear whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from uppm.core.errors import InputError


@contextmanager
def whole_folder(output: Path) -> Generator[Path, None, None]:
    """A folder to fill, beside the final one, whose name it takes at the end; after an error nothing is left of it.

    Raises
    ------
    InputError
        The folder exists, or its parent does not.
    """
    if output.exists():
        raise InputError(output, expected="a new folder", found="an existing one", advice="name another or remove it")
    if not output.parent.is_dir():
        raise InputError(output.parent, expected="a folder", found="nothing there", advice="make it or name another")
    temporary = Path(tempfile.mkdtemp(prefix=f".{output.name}.", dir=output.parent))
    try:
        yield temporary
        temporary.chmod(0o755)  # mkdtemp's folders are the owner's alone
        temporary.rename(output)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
