"""The published architectures without their weights: folders of configurations from which random networks are drawn."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tokenizers.pre_tokenizers import ByteLevel

from uppm.core.errors import ConfigError
from uppm.perception.models.network import import_torch
from uppm.perception.models.store import RANDOM_MARKER

BERT_TOKENS, FLORENCE_TOKENS = 30522, 51289
CLIP_TOKENS = "<|startoftext|>", "<|endoftext|>"
FLORENCE_PLACES = 577
"""What Florence-2's language model sees of an image of 768 pixels a side: 24 by 24 places, and their mean."""


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


def _save(folder: Path, *parts: Any) -> None:
    for part in parts:
        part.save_pretrained(folder)


def _own(folder: Path) -> None:
    """Networks of this package know their sizes."""


def _vocabulary(folder: Path) -> None:
    """As many word pieces as bert-base-uncased has, of which letters are real; [PAD] to [MASK] have their numbers."""
    letters = "abcdefghijklmnopqrstuvwxyz0123456789.,|-"
    real = {100: "[UNK]", 101: "[CLS]", 102: "[SEP]", 103: "[MASK]", 1012: ".", 1029: "?", 0: "[PAD]"}
    pieces = iter([*(c for c in letters if c != "."), *(f"##{c}" for c in letters)])
    tokens = [real.get(i) or next(pieces, f"[unused{i}]") for i in range(BERT_TOKENS)]
    (folder / "vocab.txt").write_text("\n".join(tokens) + "\n", encoding="utf-8")


def _grounding_dino(**swin: Any) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        import transformers

        _vocabulary(folder)
        stages: dict[str, Any] = {"out_features": ["stage2", "stage3", "stage4"]}
        backbone = transformers.SwinConfig(**swin, **stages)
        config = transformers.GroundingDinoConfig(backbone_config=backbone, text_config=transformers.BertConfig())
        images = transformers.GroundingDinoImageProcessorPil(size={"shortest_edge": 800, "longest_edge": 1333})
        _save(folder, config, transformers.BertTokenizer.from_pretrained(folder), images)

    return write


def _owl(kind: str, side: int, patch: int) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        import transformers

        config = getattr(transformers, f"{kind}Config")(vision_config={"image_size": side, "patch_size": patch})
        tokens = transformers.CLIPTokenizer.from_pretrained(_byte_pairs(folder, CLIP_TOKENS))
        images = getattr(transformers, f"{kind}ImageProcessorPil")(size={"height": side, "width": side})
        _save(folder, config, tokens, images)

    return write


def _byte_pairs(folder: Path, last: Sequence[str]) -> Path:
    """A vocabulary of bytes without merges, at the beginning of words and within, and special tokens."""
    letters = [chr(c) for c in range(ord("!"), ord("~") + 1)]
    words = [*letters, *(f"{letter}</w>" for letter in letters), *last]
    (folder / "vocab.json").write_text(json.dumps({word: i for i, word in enumerate(words)}), encoding="utf-8")
    (folder / "merges.txt").write_text("#version: 0.2\n", encoding="utf-8")
    return folder


def _florence2(layers: int, width: int, heads: int) -> Callable[[Path], None]:
    """DaViT-B and BART; texts are bytes without merges, and a thousand places."""

    def write(folder: Path) -> None:
        import transformers

        letters = sorted(ByteLevel.alphabet())
        words = {token: i for i, token in enumerate(["<s>", "<pad>", "</s>", "<unk>", *letters, "<mask>"])}
        (folder / "vocab.json").write_text(json.dumps(words), encoding="utf-8")
        (folder / "merges.txt").write_text("#version: 0.2\n", encoding="utf-8")
        tokens = transformers.BartTokenizer.from_pretrained(folder, extra_special_tokens={"image_token": "<image>"})
        tokens.add_tokens([f"<loc_{i}>" for i in range(1000)])
        images: Any = transformers.CLIPImageProcessorPil(size={"height": 768, "width": 768}, do_center_crop=False)
        images.image_seq_length = FLORENCE_PLACES
        parsing: dict[str, Any] = {"pure_text": {}, "description_with_bboxes": {}}
        transformers.Florence2Processor(images, tokens, post_processor_config=parsing).save_pretrained(folder)
        ends: dict[str, Any] = {"bos_token_id": 0, "pad_token_id": 1, "eos_token_id": 2}
        start = {"decoder_start_token_id": 2, "forced_eos_token_id": 2, "forced_bos_token_id": 0}
        sides = {"layers": layers, "ffn_dim": 4 * width, "attention_heads": heads}
        text: dict[str, Any] = {f"{side}_{name}": n for side in ("encoder", "decoder") for name, n in sides.items()}
        bart = {"model_type": "bart", "vocab_size": FLORENCE_TOKENS, "d_model": width, **text, **ends, **start}
        transformers.Florence2Config(
            text_config=bart, vision_config={"projection_dim": width}, image_token_id=tokens.image_token_id, **ends
        ).save_pretrained(folder)

    return write


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
    "florence-2-large": _florence2(layers=12, width=1024, heads=16),
    "florence-2-base": _florence2(layers=6, width=768, heads=12),
    "grounding-dino-base": _grounding_dino(
        embed_dim=128, depths=[2, 2, 18, 2], num_heads=[4, 8, 16, 32], window_size=12, image_size=384
    ),
    "grounding-dino-tiny": _grounding_dino(embed_dim=96, depths=[2, 2, 6, 2], num_heads=[3, 6, 12, 24], window_size=7),
    "owlv2-base": _owl("Owlv2", side=960, patch=16),
    "owlvit-base-patch32": _owl("OwlViT", side=768, patch=32),
    "sam-vit-huge": _sam(
        hidden_size=1280,
        num_hidden_layers=32,
        num_attention_heads=16,
        global_attn_indexes=[7, 15, 23, 31],
        mlp_dim=5120,
    ),
    "sam-vit-base": _sam(),
    "slimsam-50": _sam(hidden_size=384, mlp_dim=1536),
    "slimsam-77": _sam(hidden_size=168, mlp_dim=696),
    "sam2.1-hiera-tiny": _sam2,
}
"""Model -> what writes its folder."""
