"""Files of models: their sums, remembered; and the lock that pins what was fetched, beside it."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uppm.core.errors import InputError

LOCK = "uppm-lock.json"


def cache_folder() -> Path:
    """`UPPM_CACHE`, else `uppm` in the XDG cache folder."""
    if given := os.environ.get("UPPM_CACHE"):
        return Path(given)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "uppm"


def offline() -> bool:
    """`UPPM_OFFLINE` or `HF_HUB_OFFLINE` is set: no network is tried."""
    return any(
        os.environ.get(name, "0").lower() not in ("", "0", "false") for name in ("UPPM_OFFLINE", "HF_HUB_OFFLINE")
    )


@dataclass(frozen=True, kw_only=True)
class Lock:
    """What a model's folder held when it was first fetched or used: it must hold that ever after."""

    repo: str
    revision: str | None
    """Commit on the hub; None: the files were put there by hand."""
    sha256: Mapping[str, str]
    """File, relative to the folder -> sum."""

    def write(self, folder: Path) -> None:
        """Put it into the folder, whole or not at all."""
        data = {"repo": self.repo, "revision": self.revision, "sha256": dict(sorted(self.sha256.items()))}
        replace_text(folder / LOCK, json.dumps(data, indent=1) + "\n")


def read_lock(folder: Path) -> Lock | None:
    """The lock in a folder, if it has one; raises InputError for one that cannot be read."""
    file = folder / LOCK
    if not file.exists():
        return None
    data = _read_object(file)
    sums = data.get("sha256")
    if not isinstance(sums, dict) or not isinstance(data.get("repo"), str):
        advice = "delete the model's folder and fetch it again"
        raise InputError(file, expected="a lock with repo, revision and sha256", found="another file", advice=advice)
    return Lock(repo=data["repo"], revision=data.get("revision"), sha256=sums)


def digest(file: Path) -> str:
    """sha256 of a file."""
    found = hashlib.sha256()
    with file.open("rb") as stream:
        while chunk := stream.read(1 << 20):
            found.update(chunk)
    return found.hexdigest()


def verify(file: Path, sha256: str, *, again: bool = False) -> None:
    """Raise `InputError` unless the file's sha256 fits; one that did is known by size and time unless `again`."""
    record = cache_folder() / "verified.json"
    known = _read_object(record)
    try:
        status = file.stat()
        state = [status.st_size, status.st_mtime_ns, sha256]
        if known.get(str(file.resolve())) == state and not again:
            return
        found = digest(file)
    except OSError as error:
        advice = "fetch the model again"
        raise InputError(file, expected="a readable file", found=error.strerror or str(error), advice=advice) from None
    if found != sha256:
        advice = "delete the file, or reinstall what brought it, so that it is fetched again"
        raise InputError(file, expected=f"sha256 {sha256}", found=f"sha256 {found}", advice=advice)
    known[str(file.resolve())] = state
    with contextlib.suppress(OSError):  # a cache that cannot be written costs two seconds, not the run
        replace_text(record, json.dumps(known, indent=1))


def _read_object(file: Path) -> dict[str, Any]:
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def replace_text(file: Path, text: str) -> None:
    """Write a file whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False, encoding="utf-8") as stream:
        stream.write(text)
    Path(stream.name).replace(file)
