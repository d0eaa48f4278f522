"""A folder of tiny networks, as UPPM_MODELS names it, and a picture for them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.perception.foundation import tiny
from uppm.core.types import Frame, Label, Provenance
from uppm.perception.fakes import fake_frame


@pytest.fixture(scope="session")
def all_models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tiny.torch_or_skip()
    return tmp_path_factory.mktemp("models")


@pytest.fixture
def models(all_models: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Makes the network of a function of `tiny`, once a session; returns its folder."""
    monkeypatch.setenv("UPPM_MODELS", str(all_models))
    monkeypatch.setenv("UPPM_OFFLINE", "1")
    return lambda kind, name=None: tiny.made(kind, all_models, name)


def noisy(frame: Frame) -> Frame:
    """The frame with noise over a gradient as its picture."""
    rng = np.random.default_rng(0)
    color = np.linspace(0, 120, 64)[None, :, None] + rng.integers(0, 120, (48, 64, 3))
    return type(frame)(**{**vars(frame), "color": color.astype(np.uint8)})


@pytest.fixture
def picture() -> Frame:
    """64x48, in front of a wall."""
    return noisy(fake_frame())


def labels(*texts: str, provenance: Provenance = Provenance.CAPTION) -> tuple[Label, ...]:
    return tuple(Label(text=text, provenance=provenance) for text in texts)
