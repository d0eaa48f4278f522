"""A network on its device: loaded once, in a fitting precision, released on close, made smaller where memory ends."""

from __future__ import annotations

import gc
import json
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from uppm.core.config import PerceptionConfig
from uppm.core.errors import ConfigError, InputError, MissingExtraError, UppmError
from uppm.perception.models.store import RANDOM_MARKER, find, model_folder
from uppm.perception.models.streams import own_stream
from uppm.perception.models.table import model_spec

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import torch

COMMAND = "pip install 'uppm[foundation]' (or `pip install -r requirements/foundation.txt`; Python 3.11 or newer)"
TORCH = ("torch", "transformers")
"""Modules of the extra `foundation`."""
T = TypeVar("T")
H = TypeVar("H")
"""What a back end needs beside its network."""


def import_torch() -> Any:
    """The module torch; raises MissingExtraError with the pip command where it is not installed."""
    try:
        import torch
        import transformers  # noqa: F401
    except ImportError as error:
        raise missing_torch(error) from None
    return torch


def missing_torch(error: ImportError) -> MissingExtraError:
    """What to say where torch or transformers is not installed."""
    return MissingExtraError(f"{error.name or 'torch'} (extra `foundation`)", COMMAND)


@dataclass(frozen=True, kw_only=True)
class Weights:
    """A model's folder, to load from."""

    name: str
    folder: Path

    @property
    def random(self) -> int | None:
        """Seed of the weights to draw where the folder holds an architecture alone; None: it has weights."""
        marker = self.folder / RANDOM_MARKER
        return int(json.loads(marker.read_text(encoding="utf-8"))["seed"]) if marker.exists() else None

    @property
    def file(self) -> Path:
        """The file of weights."""
        names = model_spec(self.name).weights
        return next((self.folder / name for name in names if (self.folder / name).is_file()), self.folder / names[0])

    def pretrained(self, kind: Any, adapt: Callable[[Any], None] = lambda config: None) -> Any:
        """A transformers model of class `kind` with this folder's configuration, adapted in place, and its weights.

        Raises
        ------
        InputError
            The weights do not fit the architecture; the message names the first keys.
        """
        torch = import_torch()
        config = kind.config_class.from_pretrained(self.folder, local_files_only=True)
        adapt(config)
        if self.random is not None:
            torch.manual_seed(self.random)
            return kind(config)
        model, info = kind.from_pretrained(self.folder, config=config, local_files_only=True, output_loading_info=True)
        self._refuse(missing=info["missing_keys"], mismatched=[key for key, *_ in info.get("mismatched_keys", ())])
        return model

    @contextmanager
    def reading(self) -> Generator[None]:
        """Inside, a file that is missing or cannot be read is one line that names the folder: raises InputError."""
        from safetensors import SafetensorError

        try:
            yield
        except (UppmError, import_torch().OutOfMemoryError):
            raise
        except (OSError, ValueError, RuntimeError, SafetensorError) as error:
            said = str(error).strip().splitlines()
            found = f"{type(error).__name__}: {said[0] if said else 'no reason given'}"
            advice = f"delete the folder and run `uppm models download {self.name}`"
            expected = f"the files of {self.name} as the hub has them"
            raise InputError(self.folder, expected=expected, found=found, advice=advice) from None

    def check_keys(self, module: torch.nn.Module, state: dict[str, torch.Tensor]) -> None:
        """Raise InputError with the keys unless tensors have exactly a module's names and shapes."""
        own = module.state_dict()
        shared = own.keys() & state.keys()
        self._refuse(
            missing=own.keys() - state.keys(),
            unexpected=state.keys() - own.keys(),
            mismatched=[key for key in shared if own[key].shape != state[key].shape],
        )

    def _refuse(self, **wrong: Any) -> None:
        said = [f"{len(keys)} {what} ({', '.join(sorted(keys)[:3])})" for what, keys in wrong.items() if keys]
        if said:
            expected, advice = f"the weights of {self.name}", f"fetch them with `uppm models download {self.name}`"
            raise InputError(self.file, expected=expected, found=f"keys: {'; '.join(said)}", advice=advice)


@dataclass(frozen=True, kw_only=True, eq=False)
class Loaded(Generic[H]):
    """A network where it runs, with what its back end needs beside it (a processor, a tokenizer)."""

    module: Any
    helper: H
    device: torch.device
    dtype: torch.dtype
    name: str

    def tensor(self, array: npt.NDArray[np.generic]) -> torch.Tensor:
        """An array on the device; floating-point numbers in the network's precision, images channels-last on a GPU."""
        torch = import_torch()
        tensor = torch.as_tensor(array)
        if self.device.type == "cuda":
            # From memory that may be swapped out a copy waits, whatever it is asked.
            tensor = tensor.pin_memory()
        dtype = self.dtype if tensor.is_floating_point() else tensor.dtype
        layout = torch.channels_last if tensor.ndim == 4 and self.device.type == "cuda" else torch.preserve_format
        return tensor.to(self.device, dtype, non_blocking=True, memory_format=layout)


class Network(Generic[H]):
    """One model, loaded at its first use.

    Where the device's memory does not hold it, the next smaller model of its family that is on this machine takes its
    place, at last the CPU; each step warns once, and the frame at hand is done again.

    Parameters
    ----------
    config : PerceptionConfig
        `device`, `precision`, `compile`, `ahead` and `threads` count.
    name : str
        In `uppm models list`.
    load : callable
        Weights -> (torch module, whatever the back end needs beside it).
    hot : callable, optional
        Module -> the parts to compile; None: the module itself.
    """

    def __init__(
        self,
        config: PerceptionConfig,
        name: str,
        load: Callable[[Weights], tuple[Any, H]],
        hot: Callable[[Any], Sequence[Any]] | None = None,
    ) -> None:
        self._torch = import_torch()
        self._config, self._load, self._hot = config, load, hot or (lambda module: (module,))
        self._steps = self._ladder(name)
        self._name, self._device = next(self._steps)
        self._loaded: Loaded[H] | None = None

    def run(self, use: Callable[[Loaded[H]], T]) -> T:
        """What `use` makes of the network, without gradients; done again, smaller, where memory ends.

        With `perception.ahead` a GPU computes it on a stream of perception's own, and is done when this returns.
        """
        while True:
            try:
                with self._torch.inference_mode(), own_stream(self._device, wanted=self._config.ahead):
                    return use(self._loaded or self._place())
            except self._torch.OutOfMemoryError:
                # Left before the next step: the exception's traceback holds the tensors that must be freed.
                pass
            self._step_down()

    def close(self) -> None:
        """Release the network and its memory; the next `run` would load it again."""
        self._loaded = None
        gc.collect()
        if self._device.type == "cuda":
            self._torch.cuda.empty_cache()

    def _place(self) -> Loaded[H]:
        weights = Weights(name=self._name, folder=model_folder(self._name))
        if weights.random is not None:
            warnings.warn(f"the weights of {self._name} are random", stacklevel=2)
        self._torch.set_num_threads(self._config.threads)
        with weights.reading():
            module, helper = self._load(weights)
        dtype = self._dtype()
        module = module.eval().requires_grad_(False).to(self._device, dtype)
        if self._device.type == "cuda":
            module = module.to(memory_format=self._torch.channels_last)
        if self._config.compile:
            for part in self._hot(module):
                part.compile()
        self._loaded = Loaded(module=module, helper=helper, device=self._device, dtype=dtype, name=self._name)
        return self._loaded

    def _dtype(self) -> torch.dtype:
        wanted = self._config.precision
        if wanted == "auto":
            wanted = "float16" if self._device.type == "cuda" else "float32"
        return getattr(self._torch, wanted)

    def _ladder(self, name: str) -> Iterator[tuple[str, torch.device]]:
        """Model and device: as asked; then smaller ones; then as asked on the CPU."""
        first = self._first_device()
        yield name, first
        if first.type == "cpu":
            return
        smaller = model_spec(name).smaller
        while smaller:
            if find(smaller):
                yield smaller, first
            smaller = model_spec(smaller).smaller
        yield name, self._torch.device("cpu")

    def _first_device(self) -> torch.device:
        wanted, there = self._config.device, self._torch.cuda.is_available()
        if wanted == "auto":
            wanted = "cuda" if there else "cpu"
        device = self._torch.device(wanted)
        if device.type == "cuda" and (not there or (device.index or 0) >= self._torch.cuda.device_count()):
            found, advice = "no such device", "use --set perception.device=cpu, or a torch build with CUDA"
            raise ConfigError("perception.device", expected=wanted, found=found, advice=advice)
        return device

    def _step_down(self) -> None:
        full = f"{self._name} does not fit into the memory of {self._device}"
        self.close()
        try:
            self._name, self._device = next(self._steps)
        except StopIteration:
            raise UppmError(f"{full}; take a smaller model") from None
        warnings.warn(f"{full}; going on with {self._name} on {self._device}", stacklevel=4)
