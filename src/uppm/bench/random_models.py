"""The published architectures without their weights: folders of configurations from which random networks are drawn."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from uppm.core.errors import ConfigError
from uppm.perception.models.network import import_torch
from uppm.perception.models.store import RANDOM_MARKER

BERT_TOKENS = 30522


def write_random_model(name: str, root: Path) -> Path:
    """A folder for one model; the network is drawn when it is loaded.

    Raises
    ------
    ConfigError
        The architecture is not among those that can be drawn.
    MissingExtraError
        torch or transformers is not installed.
    """
    import_torch()
    if name not in ARCHITECTURES:
        advice = "choose back ends that have one of these"
        raise ConfigError("--random-weights", expected=f"one of {', '.join(ARCHITECTURES)}", found=name, advice=advice)
    folder = root / name
    folder.mkdir(parents=True)
    (folder / RANDOM_MARKER).write_text(json.dumps({"seed": 0}), encoding="utf-8")
    ARCHITECTURES[name](folder)
    return folder


def _own(folder: Path) -> None:
    """Networks of this package know their sizes."""


def _vocabulary(folder: Path) -> None:
    """As many word pieces as bert-base-uncased has, of which letters are real; [PAD] to [MASK] have their numbers."""
    letters = "abcdefghijklmnopqrstuvwxyz0123456789.,|-"
    real = {100: "[UNK]", 101: "[CLS]", 102: "[SEP]", 103: "[MASK]", 1012: ".", 1029: "?", 0: "[PAD]"}
    pieces = iter([*(c for c in letters if c != "."), *(f"##{c}" for c in letters)])
    tokens = [real.get(i) or next(pieces, f"[unused{i}]") for i in range(BERT_TOKENS)]
    (folder / "vocab.txt").write_text("\n".join(tokens) + "\n", encoding="utf-8")


def _grounding_dino(folder: Path) -> None:
    import transformers

    _vocabulary(folder)
    swin = transformers.SwinConfig(
        embed_dim=96,
        depths=[2, 2, 6, 2],
        num_heads=[3, 6, 12, 24],
        window_size=7,
        out_features=["stage2", "stage3", "stage4"],  # pyright: ignore[reportCallIssue]
    )
    config = transformers.GroundingDinoConfig(backbone_config=swin, text_config=transformers.BertConfig())
    for part in (
        config,
        transformers.BertTokenizer.from_pretrained(folder),
        transformers.GroundingDinoImageProcessorPil(size={"shortest_edge": 800, "longest_edge": 1333}),
    ):
        part.save_pretrained(folder)


def _sam(**vision: Any) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        import transformers

        transformers.SamConfig(vision_config=transformers.SamVisionConfig(**vision)).save_pretrained(folder)
        transformers.SamImageProcessorPil().save_pretrained(folder)

    return write


def _sam2(folder: Path) -> None:
    import transformers

    transformers.Sam2Config().save_pretrained(folder)  # its defaults are Hiera tiny's


ARCHITECTURES: Mapping[str, Callable[[Path], None]] = {
    "bert-base-uncased": _vocabulary,
    "tag2text-swin-b": _own,
    "ram-plus-swin-l": _own,
    "grounding-dino-tiny": _grounding_dino,
    "sam-vit-huge": _sam(
        hidden_size=1280,
        num_hidden_layers=32,
        num_attention_heads=16,
        global_attn_indexes=[7, 15, 23, 31],
        mlp_dim=5120,
    ),
    "sam-vit-base": _sam(),
    "sam2.1-hiera-tiny": _sam2,
}
"""Model -> what writes its folder."""
