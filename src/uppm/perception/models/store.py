"""Where a model's files are: the folder `UPPM_MODELS`, our cache, the hub's cache, the hub itself; verified, always.

A sum that is known beforehand stands in the table. For other models the commit and the sums are pinned in a lock beside
the weights when they are first fetched (checked against the sums that the hub states) or first used, and verified ever
after.
"""

from __future__ import annotations

import fnmatch
import os
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from uppm.core.errors import InputError, UppmError
from uppm.perception.models.files import LOCK, Lock, cache_folder, digest, offline, read_lock, verify
from uppm.perception.models.table import ModelSpec, model_spec

RANDOM_MARKER = "random-weights.json"
"""A folder with this file holds an architecture without weights: they are drawn (`uppm bench perception`)."""


class HubError(UppmError):
    """The hub could not be asked for a model, or failed; `reason` is what it or its client said."""

    def __init__(self, spec: ModelSpec, reason: str) -> None:
        advice = f"try again (what came is kept), or put its files into $UPPM_MODELS/{spec.name}"
        super().__init__(f"model {spec.name}: expected {spec.repo} from the hub, found {reason}; {advice}")
        self.reason = reason


def ignore(_: str) -> None:
    """Report to nobody."""


def model_folder(name: str) -> Path:
    """Folder with a model's verified files; fetched from the hub where they are nowhere and a network is allowed.

    Raises
    ------
    UppmError
        The model is not there and cannot be fetched; the message says where it was looked for and what to run.
    InputError
        A file is not what it was, or not the official one.
    """
    tried: list[str] = []
    folder = find(name, tried.append)
    if folder is None and offline():
        tried.append("offline, so the hub was not asked")
    elif folder is None:
        folder = fetch(name)
    if folder is None:
        raise missing(name, tried)
    return folder


def missing(name: str, tried: list[str]) -> UppmError:
    """The error that says where a model was looked for."""
    advice = f"run `uppm models download {name}` where there is a network, or put its files into $UPPM_MODELS/{name}"
    return UppmError(f"model {name}: expected its files on this machine, found none: {'; '.join(tried)}; {advice}")


def find(name: str, report: Callable[[str], None] = ignore, *, again: bool = False) -> Path | None:
    """Folder with a model's verified files on this machine, or None; `again` reads each byte anew."""
    spec = model_spec(name)
    for place in (_in_models, _in_own_cache, _in_cache):
        folder = place(spec, report)
        if folder is not None:
            check(spec, folder, again=again)
            return folder
    return None


def check(spec: ModelSpec, folder: Path, *, again: bool = False) -> None:
    """Raise InputError for the first file that is not what the table or the lock says; pin what is seen first."""
    if (folder / RANDOM_MARKER).exists():
        return
    home = lock_home(spec, folder)
    lock = read_lock(home)
    if lock is None:
        sums = {path.name: spec.sha256.get(path.name) or digest(path) for path in _files(spec, folder)}
        lock = Lock(repo=spec.repo, revision=_commit(folder), sha256=sums)
        for name, sha256 in spec.sha256.items():
            verify(folder / name, sha256)
        with suppress(OSError):  # a folder that cannot be written, on a shared disk say, stays without a lock
            lock.write(home)
    for name, sha256 in {**lock.sha256, **spec.sha256}.items():
        verify(folder / name, sha256, again=again)


def fetch(name: str) -> Path:
    """Fetch a model from the hub: to `UPPM_MODELS` where it is set, else to the hub's cache; resumed after a break.

    Raises
    ------
    UppmError
        Offline; as HubError, the hub failed.
    InputError
        A file that came is not the one that the hub, the table or the lock states.
    """
    from huggingface_hub import HfApi

    spec = model_spec(name)
    if offline():
        raise missing(name, ["offline, so the hub was not asked"])
    pinned = read_lock(_target(spec))
    revision = spec.revision or (pinned.revision if pinned else None)
    api = HfApi()
    with _hub(spec):
        info = api.repo_info(spec.repo, repo_type=spec.repo_type, revision=revision, files_metadata=True)
    stated = {file.rfilename: file.lfs.sha256 if file.lfs else None for file in getattr(info, "siblings", None) or ()}
    wanted, root = _wanted(spec, list(stated)), _models_root()
    with _hub(spec):
        folder = api.snapshot_download(
            spec.repo,
            repo_type=spec.repo_type,
            revision=info.sha,
            allow_patterns=wanted,
            local_dir=root / spec.name if root else None,
        )
    _pin(spec, Path(folder), {file: stated[file] for file in wanted}, info.sha, pinned)
    return Path(folder)


@contextmanager
def _hub(spec: ModelSpec) -> Generator[None]:
    """Whatever goes wrong between here and the hub is one line."""
    from huggingface_hub.errors import HTTPError  # pyright: ignore[reportPrivateImportUsage]

    try:
        yield
    except (OSError, ValueError, HTTPError) as error:
        said = str(error).splitlines()[0] if str(error) else "no answer"
        raise HubError(spec, f"{type(error).__name__}: {said}") from None


def _pin(spec: ModelSpec, folder: Path, stated: dict[str, str | None], revision: str | None, old: Lock | None) -> None:
    """Hold what came to the table, to an older lock and to the hub's own sums, then write the lock."""
    known = {**{k: v for k, v in stated.items() if v}, **(old.sha256 if old else {}), **spec.sha256}
    for name in stated:
        if name in known:
            verify(folder / name, known[name])
    sums = {name: known.get(name) or digest(folder / name) for name in stated}
    lock = old or Lock(repo=spec.repo, revision=revision, sha256=sums)
    replace(lock, sha256={**sums, **lock.sha256}).write(lock_home(spec, folder))


def _wanted(spec: ModelSpec, names: list[str]) -> list[str]:
    weights = [name for name in spec.weights if name in names][:1]
    if not weights:
        found, advice = ", ".join(names) or "an empty repository", "report it: the table of models is out of date"
        raise InputError(spec.repo, expected=f"one of {', '.join(spec.weights)}", found=found, advice=advice)
    return weights + [name for name in names if "/" not in name and any(fnmatch.fnmatch(name, p) for p in spec.also)]


def _models_root() -> Path | None:
    root = os.environ.get("UPPM_MODELS")
    return Path(root) if root else None


def _files(spec: ModelSpec, folder: Path) -> list[Path]:
    """The file of weights and the others that the model needs."""
    weights = [folder / name for name in spec.weights if (folder / name).is_file()][:1]
    others = {path for pattern in spec.also for path in folder.glob(pattern) if path.name != LOCK}
    return weights + sorted(others - set(weights))


def _complete(spec: ModelSpec, folder: Path) -> bool:
    named = [pattern for pattern in spec.also if "*" not in pattern]
    some = any((folder / name).is_file() for name in (*spec.weights, RANDOM_MARKER))
    return some and all((folder / name).is_file() for name in named)


def _in_models(spec: ModelSpec, report: Callable[[str], None]) -> Path | None:
    root = _models_root()
    if root is None:
        report("UPPM_MODELS is not set")
        return None
    folder = root / spec.name
    if not _complete(spec, folder):
        report(
            f"{folder} holds no {' or '.join(spec.weights)}{''.join(f' with {n}' for n in spec.also if '*' not in n)}"
        )
        return None
    return folder


def _in_own_cache(spec: ModelSpec, report: Callable[[str], None]) -> Path | None:
    """What pip wheels brought is unpacked there (`perception.retrieval.weights`)."""
    folder = cache_folder() / spec.name
    return folder if _complete(spec, folder) else None


def _in_cache(spec: ModelSpec, report: Callable[[str], None]) -> Path | None:
    """The snapshot of the pinned commit in the hub's cache, or of the one that its branch `main` had."""
    home = _cache_home(spec)
    pinned, main = read_lock(home), home / "refs" / "main"
    revision = spec.revision or (pinned.revision if pinned else None)
    if revision is None and main.is_file():
        revision = main.read_text(encoding="utf-8").strip()
    folder = home / "snapshots" / (revision or "main")
    return folder if _complete(spec, folder) else report("not in the hub's cache")


def _cache_home(spec: ModelSpec) -> Path:
    """The folder of a repository in the hub's cache, which holds its snapshots."""
    from huggingface_hub import constants

    return Path(constants.HF_HUB_CACHE) / "--".join([f"{spec.repo_type}s", *spec.repo.split("/")])


def lock_home(spec: ModelSpec, folder: Path) -> Path:
    """Beside the weights; in the hub's cache, where a folder is one commit's, beside the commits."""
    home = _cache_home(spec)
    return home if home in folder.parents else folder


def _target(spec: ModelSpec) -> Path:
    root = _models_root()
    return root / spec.name if root else _cache_home(spec)


def _commit(folder: Path) -> str | None:
    """The commit that a folder of the hub's cache is named by."""
    return folder.name if folder.parent.name == "snapshots" else None
