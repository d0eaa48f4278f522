"""Torch, or a reason; and an own folder of models."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.perception.captioners import seeded
from uppm.perception.models.network import COMMAND


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A models folder with the tiny vocabulary; no other model is on this machine, and no network is tried."""
    torch = pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)
    torch.set_num_threads(1)  # threads that wait for each other cost more than such small networks
    monkeypatch.setenv("UPPM_MODELS", str(tmp_path / "models"))
    monkeypatch.setenv("UPPM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("UPPM_OFFLINE", "1")
    seeded.write_vocabulary(tmp_path / "models")
    return tmp_path / "models"
