"""Device, precision, falling back and releasing, with toy networks; no CUDA is needed."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.perception.models.conftest import NAME
from uppm.core.config import PerceptionConfig
from uppm.core.errors import ConfigError, InputError, MissingExtraError, UppmError
from uppm.perception.fakes import fake_frame
from uppm.perception.models.files import LOCK
from uppm.perception.models.network import COMMAND, Loaded, Network, Weights, import_torch
from uppm.perception.models.store import RANDOM_MARKER

torch = pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)


@pytest.fixture
def models(machine: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A models folder with two sizes of SAM, weights to be drawn."""
    for name in ("sam-vit-large", NAME):
        folder = machine / "models" / name
        folder.mkdir(parents=True)
        (folder / RANDOM_MARKER).write_text(json.dumps({"seed": 1}))
    monkeypatch.setenv("UPPM_MODELS", str(machine / "models"))
    return machine / "models"


def load(weights: Weights) -> tuple[Any, str]:
    return torch.nn.Conv2d(3, 4, 1), weights.name


def out_of_memory(loaded: Loaded[str]) -> str:
    raise torch.OutOfMemoryError("no room")


@pytest.mark.filterwarnings("ignore:the weights of")
def test_a_network_is_loaded_once_and_again_after_close(models: Path) -> None:
    loads: list[str] = []

    def counted(weights: Weights) -> tuple[Any, str]:
        loads.append(weights.name)
        return load(weights)

    network = Network(PerceptionConfig(), NAME, counted)
    assert loads == []
    for _ in range(2):
        assert network.run(lambda loaded: (loaded.name, loaded.device.type)) == (NAME, "cpu")
    network.close()
    network.run(lambda loaded: loaded.name)
    assert loads == [NAME, NAME]


@pytest.mark.filterwarnings("ignore:the weights of")
@pytest.mark.parametrize(("precision", "kept"), [("auto", "float32"), ("bfloat16", "bfloat16")])
def test_arrays_and_weights_take_the_precision(models: Path, precision: Any, kept: str) -> None:
    network = Network(PerceptionConfig(precision=precision), NAME, load)

    def use(loaded: Loaded[str]) -> tuple[str, str, bool]:
        image = loaded.tensor(np.ones((1, 3, 5, 7), dtype=np.float32))
        out = loaded.module(image)
        return str(out.dtype), str(loaded.tensor(np.arange(3)).dtype), out.requires_grad

    assert network.run(use) == (f"torch.{kept}", "torch.int64", False)


def test_random_weights_are_warned_of(models: Path) -> None:
    with pytest.warns(UserWarning, match=f"the weights of {NAME} are random"):
        Network(PerceptionConfig(), NAME, load).run(lambda loaded: None)


@pytest.mark.filterwarnings("ignore:the weights of")
def test_where_memory_ends_a_smaller_model_then_the_cpu_take_over(
    models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    network = Network(PerceptionConfig(), "sam-vit-large", load)
    # As on a machine with a GPU; the CPU plays its part.
    cpu = torch.device("cpu")
    monkeypatch.setattr(network, "_steps", iter([(NAME, cpu), ("sam-vit-large", cpu)]))
    left = [2]

    def use(loaded: Loaded[str]) -> str:
        if left[0]:
            left[0] -= 1
            raise torch.OutOfMemoryError("no room")
        return loaded.helper

    with pytest.warns(UserWarning, match="does not fit") as warned:
        assert network.run(use) == "sam-vit-large"
    steps = [str(w.message) for w in warned if "does not fit" in str(w.message)]
    assert steps == [
        f"sam-vit-large does not fit into the memory of cpu; going on with {NAME} on cpu",
        f"{NAME} does not fit into the memory of cpu; going on with sam-vit-large on cpu",
    ]


@pytest.mark.filterwarnings("ignore:the weights of")
def test_the_ladder_goes_down_the_family_and_ends_on_the_cpu(models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    network = Network(PerceptionConfig(), "sam-vit-large", load)
    monkeypatch.setattr(network, "_first_device", lambda: torch.device("cuda"))
    steps = [(name, device.type) for name, device in network._ladder("sam-vit-huge")]
    assert steps == [("sam-vit-huge", "cuda"), ("sam-vit-large", "cuda"), (NAME, "cuda"), ("sam-vit-huge", "cpu")]


@pytest.mark.filterwarnings("ignore:the weights of")
def test_without_any_step_left_it_is_an_error(models: Path) -> None:
    with pytest.raises(UppmError, match="take a smaller model"):
        Network(PerceptionConfig(), NAME, load).run(out_of_memory)


def test_a_device_that_is_not_there(models: Path) -> None:
    if torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    with pytest.raises(ConfigError, match=r"perception\.device: expected cuda, found no such device"):
        Network(PerceptionConfig(device="cuda"), NAME, load)


def test_on_a_gpu_numbers_are_half_precision_images_channels_last_and_copies_from_pinned_memory(
    models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What would be sent there; no GPU is needed."""
    cuda, sent, pinned = torch.device("cuda"), list[tuple[Any, Any]](), list[Any]()
    network = Network(PerceptionConfig(), NAME, load)
    monkeypatch.setattr(network, "_device", cuda)
    assert network._dtype() == torch.float16

    def to(self: Any, device: Any, dtype: Any, *, non_blocking: bool, memory_format: Any) -> Any:
        assert (device, non_blocking, self is pinned[-1]) == (cuda, True, True)
        sent.append((dtype, memory_format))
        return self

    monkeypatch.setattr(torch.Tensor, "to", to)
    monkeypatch.setattr(torch.Tensor, "pin_memory", lambda self: pinned.append(self.clone()) or pinned[-1])
    loaded = Loaded(module=None, helper="", device=cuda, dtype=torch.float16, name=NAME)
    for array in (np.zeros((1, 3, 4, 4), dtype=np.float32), np.zeros(3, dtype=np.float32), np.arange(3)):
        loaded.tensor(array)
    preserved = torch.preserve_format
    expected = [(torch.float16, torch.channels_last), (torch.float16, preserved), (torch.int64, preserved)]
    assert sent == expected


@pytest.mark.filterwarnings("ignore:the weights of")
def test_compiling_is_an_option(models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[str] = []
    monkeypatch.setattr(torch.nn.Module, "compile", lambda self: compiled.append(type(self).__name__))
    for wanted in (False, True):
        Network(PerceptionConfig(compile=wanted), NAME, load).run(lambda loaded: None)
    assert compiled == ["Conv2d"]


def test_keys_that_do_not_fit_are_named(models: Path) -> None:
    weights = Weights(name=NAME, folder=models / NAME)
    linear = torch.nn.Linear(3, 2)
    state = {"weight": torch.zeros(2, 2), "gamma": torch.zeros(1)}
    with pytest.raises(InputError) as caught:
        weights.check_keys(linear, state)
    assert caught.value.found == "keys: 1 missing (bias); 1 unexpected (gamma); 1 mismatched (weight)"
    assert caught.value.source == str(models / NAME / "model.safetensors")


def test_files_that_cannot_be_read_are_one_line(models: Path) -> None:
    """Cut short, not JSON, or gone: put there by hand, so that nothing is known of them beforehand."""
    transformers = pytest.importorskip("transformers", reason=f"transformers is not installed: {COMMAND}")
    from uppm.perception.segmentation.sam import Sam

    folder = models / NAME
    (folder / RANDOM_MARKER).unlink()
    transformers.SamImageProcessorPil().save_pretrained(folder)
    transformers.SamConfig().save_pretrained(folder)
    frame, box = fake_frame(), np.array([[0, 0, 9, 9]], dtype=np.float32)
    for name, content in (("model.safetensors", b"w8ights"), ("config.json", b"{"), ("preprocessor_config.json", None)):
        file = folder / name
        before = file.read_bytes() if file.exists() else b""
        file.write_bytes(content) if content else file.unlink()
        (folder / LOCK).unlink(missing_ok=True)
        with pytest.raises(InputError, match=rf"^{folder}: expected the files of {NAME} as the hub has them") as caught:
            Sam(PerceptionConfig(masks="sam", masks_model=NAME)).masks(frame, box)
        assert "\n" not in str(caught.value)
        file.write_bytes(before or b"w8ights")


def test_without_torch_the_command_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError, match=r"torch .* pip install 'uppm\[foundation\]'"):
        import_torch()
