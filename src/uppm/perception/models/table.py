"""The literal table of models: who made them, under which licence, where the hub has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from uppm.core.errors import ConfigError

SAFETENSORS, PICKLE = "model.safetensors", "pytorch_model.bin"
MPNET = "all-mpnet-base-v2"
BERT = "bert-base-uncased"


@dataclass(frozen=True, kw_only=True)
class ModelSpec:
    """One model that can be fetched. What the hub has under `repo` is pinned when it is first fetched (`store`)."""

    name: str
    back_end: str
    """Name in `uppm.perception.registry`, or what needs the model."""
    licence: str
    """As its publisher states it."""
    megabytes: int
    """Of the weights, about."""
    repo: str
    """Repository on the Hugging Face hub."""
    repo_type: Literal["model", "space"] = "model"
    weights: tuple[str, ...] = (SAFETENSORS, PICKLE)
    """Names that the file of weights may have, the preferred one first."""
    also: tuple[str, ...] = ("*.json", "*.txt")
    """Patterns of the other files that are needed."""
    revision: str | None = None
    """Commit of the repository; None: pinned at the first download."""
    sha256: Mapping[str, str] = field(default_factory=dict[str, str])
    """File -> sum that is known beforehand."""
    smaller: str | None = None
    """The next smaller model of the family: taken where this one does not fit into the device's memory."""
    needs: tuple[str, ...] = ()
    """Models whose files this one needs too."""


def _family(back_end: str, licence: str, *sizes: tuple[str, int, str]) -> list[ModelSpec]:
    """Specs of one family, largest first: (name, megabytes, repository)."""
    smaller = [name for name, *_ in sizes[1:]]
    return [
        ModelSpec(name=name, back_end=back_end, licence=licence, megabytes=megabytes, repo=repo, smaller=below)
        for (name, megabytes, repo), below in zip(sizes, [*smaller, None], strict=True)
    ]


_APACHE, _MIT = "Apache-2.0", "MIT"
_SPECS = [
    ModelSpec(
        name=MPNET,
        back_end="retrieval",
        licence=_APACHE,
        megabytes=438,
        repo=f"sentence-transformers/{MPNET}",
        weights=(SAFETENSORS,),
        also=("tokenizer.json",),
        sha256={SAFETENSORS: "78c0197b6159d92658e319bc1d72e4c73a9a03dd03815e70e555c5ef05615658"},
    ),
    ModelSpec(
        name="tag2text-swin-b",
        back_end="tag2text",
        licence=_APACHE,
        megabytes=4480,
        repo="xinyu1205/Recognize_Anything-Tag2Text",
        repo_type="space",
        weights=("tag2text_swin_14m.pth",),
        also=(),
        needs=(BERT,),
    ),
    ModelSpec(
        name="ram-plus-swin-l",
        back_end="ram_plus",
        licence=_APACHE,
        megabytes=3010,
        repo="xinyu1205/recognize-anything-plus-model",
        weights=("ram_plus_swin_large_14m.pth",),
        also=(),
    ),
    ModelSpec(
        name=BERT,
        back_end="tag2text",
        licence=_APACHE,
        megabytes=1,
        repo=f"google-bert/{BERT}",
        weights=("vocab.txt",),
        also=(),
    ),
    *_family(
        "florence2",
        _MIT,
        ("florence-2-large", 1540, "florence-community/Florence-2-large"),
        ("florence-2-base", 460, "florence-community/Florence-2-base"),
    ),
    *_family(
        "grounding_dino",
        _APACHE,
        ("grounding-dino-base", 930, "IDEA-Research/grounding-dino-base"),
        ("grounding-dino-tiny", 690, "IDEA-Research/grounding-dino-tiny"),
    ),
    *_family(
        "mm_grounding_dino",
        _APACHE,
        ("mm-grounding-dino-tiny", 690, "openmmlab-community/mm_grounding_dino_tiny_o365v1_goldg_v3det"),
    ),
    *_family("sam3", "SAM License", ("sam3", 3440, "facebook/sam3")),
    *_family("owlvit", _APACHE, ("owlvit-base-patch32", 613, "google/owlvit-base-patch32")),
    *_family("owlv2", _APACHE, ("owlv2-base", 620, "google/owlv2-base-patch16-ensemble")),
    *_family(
        "sam",
        _APACHE,
        ("sam-vit-huge", 2560, "facebook/sam-vit-huge"),
        ("sam-vit-large", 1250, "facebook/sam-vit-large"),
        ("sam-vit-base", 375, "facebook/sam-vit-base"),
        ("slimsam-50", 112, "Zigeng/SlimSAM-uniform-50"),
        ("slimsam-77", 39, "Zigeng/SlimSAM-uniform-77"),
    ),
    ModelSpec(
        name="mobile-sam",
        back_end="mobile_sam",
        licence=_APACHE,
        megabytes=45,
        repo="Acly/MobileSAM",
        weights=("mobile_sam_image_encoder.onnx",),
        also=("sam_mask_decoder_single.onnx",),
    ),
    *_family(
        "sam2",
        _APACHE,
        ("sam2.1-hiera-large", 900, "facebook/sam2.1-hiera-large"),
        ("sam2.1-hiera-base-plus", 325, "facebook/sam2.1-hiera-base-plus"),
        ("sam2.1-hiera-small", 185, "facebook/sam2.1-hiera-small"),
        ("sam2.1-hiera-tiny", 156, "facebook/sam2.1-hiera-tiny"),
    ),
    *_family(
        "mask2former",
        "MIT (code); see the model card",
        ("mask2former-swin-large", 870, "facebook/mask2former-swin-large-coco-panoptic"),
        ("mask2former-swin-tiny", 190, "facebook/mask2former-swin-tiny-coco-panoptic"),
    ),
    *_family("oneformer", _MIT, ("oneformer-swin-large", 880, "shi-labs/oneformer_coco_swin_large")),
    *_family(
        "clip",
        "MIT (code); see the model card",
        ("clip-vit-large", 1710, "openai/clip-vit-large-patch14"),
        ("clip-vit-base", 605, "openai/clip-vit-base-patch32"),
    ),
    *_family(
        "ram_plus_tags",
        "MIT (code); see the model card",
        ("clip-vit-base-patch16", 600, "openai/clip-vit-base-patch16"),
    ),
    *_family("siglip", _APACHE, ("siglip-base", 810, "google/siglip-base-patch16-224")),
]
MODELS: Mapping[str, ModelSpec] = {spec.name: spec for spec in _SPECS}


def model_spec(name: str) -> ModelSpec:
    """The row of a name; raises ConfigError with the names that there are."""
    if name not in MODELS:
        found, advice = repr(name), "see `uppm models list`"
        raise ConfigError("model", expected=f"one of {', '.join(MODELS)}", found=found, advice=advice)
    return MODELS[name]


def with_needs(names: list[str]) -> list[str]:
    """The names and what they need, each once, in order."""
    return list(dict.fromkeys(part for name in names for part in (name, *model_spec(name).needs)))
