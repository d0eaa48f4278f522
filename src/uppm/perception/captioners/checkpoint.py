"""Checkpoints of the recognize-anything family (Tag2Text, RAM++) and what goes with them; for back ends alone."""

from __future__ import annotations

import dataclasses
import json
import pickle
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from uppm.core.errors import InputError
from uppm.perception.captioners.swin import TRAINING_BUFFERS
from uppm.perception.models.network import Weights

ARCHITECTURE, TAGS, THRESHOLDS = "architecture.json", "tags.txt", "thresholds.txt"
"""Files that a model's folder may hold: sizes, tags and thresholds other than the published checkpoint's."""
MEAN, STD = np.array([[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]], dtype=np.float32)
"""ImageNet's, by channel."""
M = TypeVar("M", bound=nn.Module)
S = TypeVar("S")


def square_image(color: npt.NDArray[np.uint8], side: int) -> npt.NDArray[np.float32]:
    """(1, 3, side, side): resized without regard to its shape, as in training, and normalised."""
    from PIL import Image

    small = Image.fromarray(color).resize((side, side), Image.Resampling.BILINEAR)
    image = (np.asarray(small, dtype=np.float32) / 255 - MEAN) / STD
    return np.ascontiguousarray(image.transpose(2, 0, 1)[None])


def read_checkpoint(
    weights: Weights,
    make: Callable[[], M],
    *,
    renamed: Mapping[str, str] | None = None,
) -> M:
    """A network with the checkpoint's weights, whose names and shapes must be the network's own.

    Left out are buffers that follow from the architecture. `renamed` holds parts that had another name once.
    """
    if weights.random is not None:
        torch.manual_seed(weights.random)
        network = make()
        for parameter in network.parameters():
            nn.init.normal_(parameter, std=0.02)
        return network
    state = _read_state(weights)
    kept = {
        _rename(name, renamed or {}): tensor
        for name, tensor in state.items()
        if name.rpartition(".")[2] not in (*TRAINING_BUFFERS, "position_ids")
    }
    with torch.device("meta"):  # the checkpoint's own tensors become the network's, and no memory is filled twice
        network = make()
    weights.check_keys(network, kept)
    network.load_state_dict(kept, strict=True, assign=True)
    return network


def _rename(name: str, parts: Mapping[str, str]) -> str:
    for old, new in parts.items():
        name = name.replace(old, new)
    return name


def _read_state(weights: Weights) -> dict[str, Any]:
    expected, advice = "a checkpoint with the weights under `model`", f"run `uppm models verify {weights.name}`"
    try:
        found = torch.load(weights.file, map_location="cpu", weights_only=True, mmap=True)
    except (OSError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        said = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise InputError(weights.file, expected=expected, found=said, advice=advice) from None
    state = found.get("model") if isinstance(found, dict) else None
    if not isinstance(state, dict):
        raise InputError(weights.file, expected=expected, found=type(found).__name__, advice=advice)
    return state


def read_architecture(folder: Path, default: S) -> S:
    """The sizes (a dataclass of dataclasses) that a folder states in architecture.json; those it leaves out stay."""
    file = folder / ARCHITECTURE
    if not file.exists():
        return default
    return _replaced(default, json.loads(file.read_text(encoding="utf-8")))


def _replaced(default: Any, given: Mapping[str, Any]) -> Any:
    changed = {
        name: _replaced(getattr(default, name), value)
        if isinstance(value, Mapping)
        else tuple(value)
        if isinstance(value, list)
        else value
        for name, value in given.items()
    }
    return dataclasses.replace(default, **changed)


def read_tags(folder: Path, shipped: str, count: int) -> tuple[str, ...]:
    """The tags, one a line, of a folder's tags.txt, else of the package's list."""
    own = folder / TAGS
    source = own if own.exists() else resources.files("uppm.data").joinpath(shipped)
    tags = tuple(source.read_text(encoding="utf-8").splitlines())
    if len(tags) != count:
        advice = "take the list that goes with the checkpoint"
        raise InputError(str(source), expected=f"{count} tags, one a line", found=str(len(tags)), advice=advice)
    return tags


def read_thresholds(folder: Path, shipped: str, count: int) -> npt.NDArray[np.float64]:
    """The tags' thresholds, one a line, of a folder's thresholds.txt, else of the package's list."""
    own = folder / THRESHOLDS
    source = own if own.exists() else resources.files("uppm.data").joinpath(shipped)
    lines = source.read_text(encoding="utf-8").split()
    try:
        found = np.array([float(line) for line in lines])
    except ValueError as error:
        found = np.zeros(0)
        lines = [str(error)]
    if len(found) != count:
        advice = "take the list that goes with the checkpoint"
        said = f"{len(found)} numbers" if len(found) else lines[0] if lines else "nothing"
        raise InputError(str(source), expected=f"{count} numbers, one a line", found=said, advice=advice)
    return found
