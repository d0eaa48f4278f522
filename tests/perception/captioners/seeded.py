"""Tiny networks of the real architectures: sizes, vocabulary, and weights that follow from their names alone.

The golden files beside were computed by the models' own reference code with the same weights.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.types import Frame, Intrinsics, Label, PanopticSegmentation
from uppm.perception.fakes import FakeSegmenter

SWIN = {"image": 64, "width": 16, "depths": [2, 2, 2, 2], "heads": [2, 2, 4, 4], "window": 4}
TEXT = {"width": 32, "layers": 2, "heads": 4, "inner": 64, "positions": 64, "vocabulary": 92}
TAGGING = {"width": 32, "layers": 2, "heads": 2, "inner": 64}
LETTERS = "abcdefghijklmnopqrstuvwxyz"
WORDS = [
    *("[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", "|", ".", ",", "'", "-"),
    *("picture", "of", "the", "chair", "table", "room", "with", "and", "on", "lamp", "white", "dog", "man", "in"),
    *(
        "desk",
        "floor",
        "wall",
        "window",
        "book",
        "shelf",
        "couch",
        "plant",
        "blurry",
        "two",
        "##ing",
        "##ed",
        "is",
        "an",
    ),
    *LETTERS,
    *(f"##{letter}" for letter in LETTERS),
]
"""90 tokens: 38 and the letters at the beginning of a word and within."""


def image(seed: int) -> npt.NDArray[np.uint8]:
    """(64, 64, 3): blotches of colour."""
    coarse = np.random.default_rng(seed).integers(0, 256, (8, 8, 3))
    return coarse.repeat(8, axis=0).repeat(8, axis=1).astype(np.uint8)


def frame(seed: int) -> Frame:
    """A frame whose colours are `image`'s."""
    k = Intrinsics(fx=64, fy=64, cx=31.5, cy=31.5, width=64, height=64)
    depth = np.ones((64, 64), dtype=np.float32)
    return Frame(index=0, stamp=0, color=image(seed), depth=depth, T_map_camera=np.eye(4), intrinsics=k)


def seeded_weights(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, npt.NDArray[np.float32]]:
    """Name -> values that depend on name and shape alone; what a model ties has one name for it."""
    return {name: _values(canonical(name), shape) for name, shape in shapes.items()}


def canonical(name: str) -> str:
    """One name for tied weights: Tag2Text's lowest encoder layers and its tagging head; words read and written."""
    name = re.sub(r"^tag_encoder\.(encoder\.layer\.[01]\.(?:cross|intermediate|output))", r"tagging_head.\1", name)
    name = name.replace("cls.predictions.decoder.weight", "bert.embeddings.word_embeddings.weight")
    return name.replace("cls.predictions.bias", "cls.predictions.decoder.bias")


def _values(name: str, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
    noise = np.random.default_rng(zlib.crc32(name.encode())).standard_normal(shape, dtype=np.float32)
    if re.search(r"[Nn]orm\d?\.weight$", name):
        return 1 + 0.1 * noise
    if name == "reweight_scale":
        return np.full(shape, 2.0, dtype=np.float32)
    if name == "label_embed":
        return noise
    if name == "fc.weight":
        return 2 * noise
    if name == "fc.b":
        return 0.3 * noise - 4.2
    if name.endswith("decoder.bias"):
        noise[WORDS.index("[SEP]")] = 14.0  # so that captions end
        return noise
    if name.endswith("bias"):
        return 0.1 * noise
    if name == "fc.W":
        return 0.3 * noise
    if re.search(r"(word|position)_embeddings|transform\.dense", name):
        return noise
    scale = 0.5 if "output.dense" in name else 1.5  # else what a layer adds hides the words
    return noise * np.float32(scale / np.sqrt(max(shape[1:] and np.prod(shape[1:]), 1)) if len(shape) > 1 else 0.5)


def write_vocabulary(root: Path) -> None:
    """A folder `bert-base-uncased` with the tiny vocabulary."""
    folder = root / "bert-base-uncased"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.txt").write_text("\n".join(WORDS) + "\n")


def write_folder(root: Path, name: str, architecture: Mapping[str, Any]) -> Path:
    """A model's folder that states its sizes."""
    folder = root / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "architecture.json").write_text(json.dumps(architecture))
    return folder


class Noting(FakeSegmenter):
    """FakeSegmenter that notes what it is asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[tuple[Label, ...]] = []

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        self.asked.append(tuple(labels))
        return super().segment(frame, labels)
