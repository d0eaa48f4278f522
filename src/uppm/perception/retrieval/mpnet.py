"""all-mpnet-base-v2 by onnxruntime: the shipped graph with the weights of the official model.safetensors."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.perception.retrieval.weights import TOKENIZER, WEIGHTS, model_folder

DIMENSION = 768
MAX_TOKENS = 384
FIRST_POSITION = 2
"""MPNet counts positions from its padding id + 1."""
UNUSED = "pooler."
"""Weights of the file that sentence embedding does not use."""


class MpnetEncoder:
    """E of paper equation 1; a `TextEncoder`. The model is looked for and loaded at the first text.

    Parameters
    ----------
    folder : Path, optional
        Holds model.safetensors and tokenizer.json; None: found by `weights.model_folder`, which verifies it.
    threads : int
        Of onnxruntime, for one text.
    """

    def __init__(self, folder: Path | None = None, threads: int = 2) -> None:
        self._given, self._threads = folder, threads

    def encode(self, texts: Sequence[str]) -> npt.NDArray[np.float32]:
        """Unit vectors (N, 768). One text a run, so that its vector does not depend on the others.

        Raises
        ------
        UppmError
            The model cannot be found, or is not the official one.
        """
        vectors = np.empty((len(texts), DIMENSION), dtype=np.float32)
        for row, text in enumerate(texts):
            ids = np.asarray(self._tokenizer.encode(text).ids, dtype=np.int64)
            positions = np.arange(len(ids)) + FIRST_POSITION
            feed = {"ids": ids, "positions": positions, "buckets": relative_buckets(len(ids))}
            vectors[row] = self._session.run(None, feed)[0]
        return vectors

    @cached_property
    def _folder(self) -> Path:
        return self._given if self._given is not None else model_folder()

    @cached_property
    def _tokenizer(self) -> Any:
        from tokenizers import Tokenizer

        tokenizer = Tokenizer.from_file(str(self._folder / TOKENIZER))
        tokenizer.no_padding()
        tokenizer.enable_truncation(MAX_TOKENS)
        return tokenizer

    @cached_property
    def _session(self) -> Any:
        import onnxruntime

        self._arrays = read_safetensors(self._folder / WEIGHTS)  # kept: the session may refer to their memory
        weights = {name: array for name, array in self._arrays.items() if not name.startswith(UNUSED)}
        values = [onnxruntime.OrtValue.ortvalue_from_numpy(array) for array in weights.values()]
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self._threads
        options.add_external_initializers(list(weights), values)
        graph = resources.files("uppm.data").joinpath("mpnet.onnx").read_bytes()
        return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])


def read_safetensors(file: Path) -> dict[str, npt.NDArray[np.float32]]:
    """Name -> array of every float32 tensor, mapped from the file, not copied.

    Raises
    ------
    InputError
        The file is not safetensors, or is cut short.
    """
    try:
        data = np.memmap(file, mode="r")
        start = 8 + int(data[:8].view("<u8")[0])
        if start > len(data):
            raise ValueError(f"a header of {start - 8} bytes in a file of {len(data)}")
        header = json.loads(bytes(data[8:start]))
        header.pop("__metadata__", None)
        return {
            name: data[start + entry["data_offsets"][0] : start + entry["data_offsets"][1]]
            .view("<f4")
            .reshape(entry["shape"])
            for name, entry in header.items()
            if entry["dtype"] == "F32"
        }
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        advice = "fetch the file again"
        raise InputError(file, expected="a safetensors file", found=str(error), advice=advice) from None


def relative_buckets(length: int) -> npt.NDArray[np.int64]:
    """(T, T) bucket of each key's distance from each query: half for either side, exact to 8, logarithmic to 128."""
    distance = np.arange(length)[:, None] - np.arange(length)
    far = np.maximum(np.abs(distance), 1).astype(np.float32) / np.float32(8)
    logarithmic = 8 + (np.log(far) / np.float32(np.log(16)) * 8).astype(np.int64)
    bucket = np.where(np.abs(distance) < 8, np.abs(distance), np.minimum(logarithmic, 15))
    return (distance < 0) * 16 + bucket
