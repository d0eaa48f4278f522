"""The stream on which a GPU computes what perception does ahead: its logic without a GPU, its effect with one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.perception.models.conftest import NAME
from uppm.core.config import PerceptionConfig
from uppm.perception.models import streams
from uppm.perception.models.network import COMMAND, Loaded, Network, Weights
from uppm.perception.models.store import RANDOM_MARKER

torch = pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)
pytestmark = pytest.mark.filterwarnings("ignore:the weights of")


@pytest.fixture(autouse=True)
def no_stream_yet() -> Iterator[None]:
    streams._stream.cache_clear()
    yield
    streams._stream.cache_clear()


@pytest.fixture
def model(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One model, weights to be drawn."""
    folder = machine / "models" / NAME
    folder.mkdir(parents=True)
    (folder / RANDOM_MARKER).write_text(json.dumps({"seed": 1}))
    monkeypatch.setenv("UPPM_MODELS", str(machine / "models"))


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is asked of CUDA's streams, in order; no GPU is needed."""
    told: list[str] = []

    class Stream:
        def __init__(self, device: Any) -> None:
            self.device = device
            told.append(f"made on {device}")

        def synchronize(self) -> None:
            told.append(f"waited for {self.device}")

    @contextmanager
    def stream(chosen: Stream) -> Iterator[None]:
        told.append(f"entered on {chosen.device}")
        try:
            yield
        finally:
            told.append("left")

    monkeypatch.setattr(torch.cuda, "Stream", Stream)
    monkeypatch.setattr(torch.cuda, "stream", stream)
    return told


class Module:
    """Stands for a network on whatever device."""

    def eval(self) -> Module:
        return self

    def requires_grad_(self, wanted: bool) -> Module:
        return self

    def to(self, *args: Any, **kwargs: Any) -> Module:
        return self


def on_gpu(told: list[str], device: str, *, ahead: bool) -> Network[str]:
    """A network that believes in a GPU, and tells when it is loaded."""

    def load(weights: Weights) -> tuple[Any, str]:
        told.append("loaded")
        return Module(), weights.name

    network = Network(PerceptionConfig(ahead=ahead), NAME, load)
    network._device = torch.device(device)
    return network


def test_ahead_a_gpu_loads_and_computes_on_a_stream_of_its_own_and_is_waited_for(model: None, told: list[str]) -> None:
    network = on_gpu(told, "cuda:1", ahead=True)
    network.run(lambda loaded: told.append("computed"))
    network.run(lambda loaded: told.append("computed"))
    once = ["computed", "left", "waited for cuda:1"]
    assert told == ["made on cuda:1", "entered on cuda:1", "loaded", *once, "entered on cuda:1", *once]


def test_all_networks_of_a_device_share_its_stream(model: None, told: list[str]) -> None:
    for device in ("cuda:0", "cuda:0", "cuda:1"):
        on_gpu(told, device, ahead=True).run(lambda loaded: None)
    assert [line for line in told if line.startswith("made")] == ["made on cuda:0", "made on cuda:1"]


@pytest.mark.parametrize(("device", "ahead"), [("cuda:0", False), ("cpu", True), ("cpu", False)])
def test_nothing_is_asked_of_cuda_elsewhere(model: None, told: list[str], device: str, ahead: bool) -> None:
    on_gpu(told, device, ahead=ahead).run(lambda loaded: told.append("computed"))
    assert told == ["loaded", "computed"]


def test_where_memory_ends_the_stream_is_left_before_the_cpu_takes_over(model: None, told: list[str]) -> None:
    network = on_gpu(told, "cuda:0", ahead=True)
    network._steps = iter([(NAME, torch.device("cpu"))])

    def use(loaded: Loaded[str]) -> str:
        if loaded.device.type == "cuda":
            raise torch.OutOfMemoryError("no room")
        told.append("computed on the cpu")
        return loaded.name

    with pytest.warns(UserWarning, match="does not fit"):
        assert network.run(use) == NAME
    assert told == ["made on cuda:0", "entered on cuda:0", "loaded", "left", "loaded", "computed on the cpu"]


def convolution(weights: Weights) -> tuple[Any, None]:
    torch.manual_seed(0)
    return torch.nn.Conv2d(3, 4, 3), None


def filtered(device: str, *, ahead: bool) -> np.ndarray:
    """What a network says of noise."""
    image = np.random.default_rng(0).normal(size=(1, 3, 32, 48)).astype(np.float32)
    network = Network(PerceptionConfig(device=device, ahead=ahead, precision="float32"), NAME, convolution)
    found = network.run(lambda loaded: loaded.module(loaded.tensor(image)).cpu().numpy())
    network.close()
    return found


def test_on_a_cpu_ahead_changes_nothing(model: None) -> None:
    np.testing.assert_array_equal(filtered("cpu", ahead=True), filtered("cpu", ahead=False))


needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU: CUDA streams themselves are not run")


@needs_gpu
def test_on_a_gpu_the_stream_is_another_and_the_result_the_same(model: None) -> None:
    np.testing.assert_allclose(filtered("cuda", ahead=True), filtered("cuda", ahead=False), atol=1e-4)
    seen = {
        ahead: Network(PerceptionConfig(device="cuda", ahead=ahead), NAME, convolution).run(
            lambda loaded: torch.cuda.current_stream() == torch.cuda.default_stream()
        )
        for ahead in (True, False)
    }
    assert seen == {True: False, False: True}


@needs_gpu
def test_on_a_gpu_copies_start_from_pinned_memory(model: None, monkeypatch: pytest.MonkeyPatch) -> None:
    pinned, to = list[bool](), torch.Tensor.to

    def noting(self: Any, *args: Any, **kwargs: Any) -> Any:
        pinned.append(self.is_pinned())
        return to(self, *args, **kwargs)

    network = Network(PerceptionConfig(device="cuda"), NAME, convolution)
    network.run(lambda loaded: None)
    monkeypatch.setattr(torch.Tensor, "to", noting)
    network.run(lambda loaded: loaded.tensor(np.ones((1, 3, 8, 8), dtype=np.float32)))
    assert pinned == [True]
