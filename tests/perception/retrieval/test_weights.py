"""Where the model is looked for, in which order, and what is said when it is not there or not the official one."""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import cast

import huggingface_hub.constants
import pytest

from uppm.core.errors import InputError, UppmError
from uppm.perception.models.table import MODELS, ModelSpec
from uppm.perception.retrieval import weights

CONTENT = b"not really weights" * 1000


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, no wheels, no models, no hub, and a small official file."""
    for name in ("UPPM_MODELS", "UPPM_OFFLINE", "HF_HUB_OFFLINE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("UPPM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    monkeypatch.setattr(huggingface_hub.constants, "ENDPOINT", "http://127.0.0.1:9")
    monkeypatch.setattr(weights, "_wheel_part", lambda _: None)
    small = replace(MODELS[weights.MODEL], sha256={weights.WEIGHTS: hashlib.sha256(CONTENT).hexdigest()})
    monkeypatch.setitem(cast("dict[str, ModelSpec]", MODELS), weights.MODEL, small)
    return tmp_path


def write_model(folder: Path, content: bytes = CONTENT) -> Path:
    folder.mkdir(parents=True)
    (folder / weights.WEIGHTS).write_bytes(content)
    (folder / weights.TOKENIZER).write_text("{}")
    return folder


def write_parts(folder: Path) -> dict[str, Path]:
    """The five slices of a zip with the model folder, by wheel."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(f"{weights.MODEL}/{weights.WEIGHTS}", CONTENT)
        archive.writestr(f"{weights.MODEL}/{weights.TOKENIZER}", "{}")
    data, step = buffer.getvalue(), len(buffer.getvalue()) // len(weights.WHEELS) + 1
    parts = {name: folder / f"{name}.zip.{n + 1:03d}" for n, name in enumerate(weights.WHEELS)}
    for n, part in enumerate(parts.values()):
        part.write_bytes(data[n * step : (n + 1) * step])
    return parts


def test_nowhere_names_the_three_places_and_commands(place: Path) -> None:
    with pytest.raises(UppmError) as caught:
        weights.model_folder()
    message = str(caught.value)
    for words in (
        "0 of the 5 wheels",
        "UPPM_MODELS is not set",
        "the hub failed",
        "requirements/mpnet.txt",
        "uppm[mpnet]",
    ):
        assert words in message
    assert "\n" not in message


def test_the_wheels_are_joined_unpacked_once_and_verified(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = write_parts(place)
    monkeypatch.setattr(weights, "_wheel_part", parts.get)
    folder = weights.model_folder()
    assert (folder / weights.WEIGHTS).read_bytes() == CONTENT
    assert sorted(path.name for path in (place / "cache").iterdir()) == [weights.MODEL, "verified.json"]
    for part in parts.values():
        part.unlink()
    assert weights.model_folder() == folder


def test_wheels_that_do_not_join_are_an_error_and_leave_nothing(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = write_parts(place)
    parts[weights.WHEELS[-1]].write_bytes(b"cut")
    monkeypatch.setattr(weights, "_wheel_part", parts.get)
    with pytest.raises(InputError, match="expected the wheels' model to unpack"):
        weights.model_folder()
    assert not any((place / "cache").iterdir())


def test_the_models_folder_comes_before_the_hub(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_model(place / "models" / weights.MODEL)
    monkeypatch.setenv("UPPM_MODELS", str(place / "models"))
    assert weights.model_folder() == folder


def test_the_hub_comes_last_and_is_not_asked_offline(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def fetch(name: str) -> Path:
        asked.append(name)
        return write_model(place / "fetched")

    monkeypatch.setattr(weights.store, "fetch", fetch)
    assert weights.model_folder() == place / "fetched"
    monkeypatch.setenv("UPPM_OFFLINE", "1")
    with pytest.raises(UppmError, match="not in the hub's cache"):
        weights.model_folder()
    assert asked == [weights.MODEL]


def test_a_corrupt_file_is_named_with_both_sums(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_model(place / "models" / weights.MODEL, CONTENT[:-1] + b"!")
    monkeypatch.setenv("UPPM_MODELS", str(place / "models"))
    with pytest.raises(InputError) as caught:
        weights.model_folder()
    assert caught.value.source == str(folder / weights.WEIGHTS)
    assert hashlib.sha256(CONTENT).hexdigest() in caught.value.expected
    assert hashlib.sha256(CONTENT[:-1] + b"!").hexdigest() in caught.value.found


def test_a_file_changed_after_it_was_verified_is_read_again(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_model(place / "models" / weights.MODEL) / weights.WEIGHTS
    monkeypatch.setenv("UPPM_MODELS", str(place / "models"))
    weights.model_folder()
    file.write_bytes(CONTENT[::-1])
    os.utime(file, ns=(1, 1))
    with pytest.raises(InputError, match="sha256"):
        weights.model_folder()
