"""An empty machine: no models, an own cache, a hub of its own that nobody asks unless a test wants it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import huggingface_hub.constants
import pytest

from tests.perception.models.hub import BIG, FakeHub

REPO = "facebook/sam-vit-base"
NAME = "sam-vit-base"
WEIGHTS = bytes(range(256)) * (BIG // 128)


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder with the caches; nothing is in them."""
    for name in ("UPPM_MODELS", "UPPM_OFFLINE", "HF_HUB_OFFLINE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("UPPM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    return tmp_path


@pytest.fixture
def hub(machine: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeHub]:
    """A hub that holds one model."""
    found = FakeHub()
    found.files[REPO] = {
        "model.safetensors": WEIGHTS,
        "pytorch_model.bin": b"not wanted" * BIG,
        "config.json": b"{}",
        "README.md": b"not wanted",
    }
    template = found.url + "/{repo_id}/resolve/{revision}/{filename}"
    monkeypatch.setattr(huggingface_hub.constants, "ENDPOINT", found.url)
    monkeypatch.setattr(huggingface_hub.constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
    yield found
    found.close()
