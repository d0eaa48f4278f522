"""Back ends by name: literal tables, imported on use, and entry points for plug-ins.

A plug-in's package declares, say, `[project.entry-points."uppm.perception"] mine = "package.module:Segmenter"`;
captioners, detectors and mask generators do so in the groups `uppm.captioners`, `uppm.detectors` and `uppm.masks`. Each
is a class that takes the `PerceptionConfig`.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from uppm.core.config import PerceptionConfig
from uppm.core.errors import ConfigError
from uppm.core.protocols import (
    Captioner,
    Detector,
    FrameSource,
    Labeler,
    MaskGenerator,
    Segmenter,
    TextEncoder,
    VisualEncoder,
)
from uppm.perception.featured import WithFeatures
from uppm.perception.labels.caption import CaptionLabeler
from uppm.perception.models.network import TORCH, missing_torch
from uppm.perception.models.table import MODELS, model_spec

SEGMENTERS = {
    "embedded": "uppm.perception.segmentation.embedded:EmbeddedSegmenter",
    "foundation": "uppm.perception.segmentation.prompted:PromptedSegmenter",
    "foundation-light": "uppm.perception.segmentation.prompted:PromptedSegmenter",
    "groundtruth": "uppm.perception.segmentation.groundtruth:GroundTruthSegmenter",
    "mask2former": "uppm.perception.segmentation.mask2former:Mask2Former",
    "oneformer": "uppm.perception.segmentation.oneformer:OneFormer",
    "precomputed": "uppm.perception.segmentation.precomputed:PrecomputedSegmenter",
    "sam3": "uppm.perception.segmentation.sam3:Sam3",
    "simulated": "uppm.perception.simulated.segmenter:SimulatedSegmenter",
}
CAPTIONERS = {
    "florence2": "uppm.perception.captioners.florence2:Florence2",
    "none": "uppm.core.nulls:NoCaptioner",
    "ram_plus": "uppm.perception.captioners.ram_plus:RamPlus",
    "simulated": "uppm.perception.simulated.captioner:SimulatedCaptioner",
    "tag2text": "uppm.perception.captioners.tag2text:Tag2Text",
    "vocabulary": "uppm.perception.captioners.vocabulary:Vocabulary",
}
DETECTORS = {
    "grounding_dino": "uppm.perception.segmentation.grounding_dino:GroundingDino",
    "mm_grounding_dino": "uppm.perception.segmentation.grounding_dino:MMGroundingDino",
    "nanodet": "uppm.perception.segmentation.nanodet:NanoDet",
    "owlv2": "uppm.perception.segmentation.owlv2:Owlv2",
    "owlvit": "uppm.perception.segmentation.owlv2:OwlVit",
}
MASK_GENERATORS = {
    "geometric": "uppm.perception.segmentation.geometric_masks:GeometricMasks",
    "box": "uppm.perception.segmentation.geometric_masks:BoxMasks",
    "mobile_sam": "uppm.perception.segmentation.mobile_sam:MobileSam",
    "sam": "uppm.perception.segmentation.sam:Sam",
    "sam2": "uppm.perception.segmentation.sam2:Sam2",
}


VISUAL_ENCODERS = {
    "clip": "uppm.perception.visual_features:Clip",
    "siglip": "uppm.perception.visual_features:Siglip",
}
LOOK_ENCODERS = {
    "clip": "uppm.perception.visual_features:ClipText",
    "siglip": "uppm.perception.visual_features:SiglipText",
}
"""The text sides of these."""


def create_segmenter(config: PerceptionConfig) -> Segmenter:
    """The front end of `config.profile`, with `config.visual_feature`; raises ConfigError for an unknown name."""
    segmenter = _create("perception.profile", config.profile, SEGMENTERS, "uppm.perception", config)
    return segmenter if config.visual_feature == "none" else WithFeatures(segmenter, create_visual_encoder(config))


def create_visual_encoder(config: PerceptionConfig) -> VisualEncoder:
    """The encoder of `config.visual_feature`; raises ConfigError for an unknown name."""
    name = config.visual_feature
    return _create("perception.visual_feature", name, VISUAL_ENCODERS, "uppm.visual_features", config)


def create_look_encoder(config: PerceptionConfig) -> TextEncoder:
    """Texts in the space of `config.visual_feature`; raises ConfigError where that has no text side."""
    name = config.visual_feature
    return _create("perception.visual_feature", name, LOOK_ENCODERS, "uppm.look_encoders", config)


def create_labeler(config: PerceptionConfig) -> Labeler:
    """Labels by the captioner of `config.captioner`; raises ConfigError for an unknown name."""
    return CaptionLabeler(create_captioner(config), use_tags=config.use_tags, skip_blurry=config.skip_blurry)


def create_captioner(config: PerceptionConfig) -> Captioner:
    """The captioner of `config.captioner`; raises ConfigError for an unknown name."""
    return _create("perception.captioner", config.captioner, CAPTIONERS, "uppm.captioners", config)


def seen_by_camera(source: FrameSource, config: PerceptionConfig) -> FrameSource:
    """A sequence as the profile's camera sees it: the simulated one blurs some of its frames."""
    if config.profile != "simulated":
        return source
    from uppm.perception.simulated.camera import SimulatedCamera

    return SimulatedCamera(source, config.simulated)


def create_detector(config: PerceptionConfig) -> Detector:
    """The detector of `config.detector`; raises ConfigError for an unknown name."""
    return _create("perception.detector", config.detector, DETECTORS, "uppm.detectors", config)


def create_mask_generator(config: PerceptionConfig) -> MaskGenerator:
    """The mask generator of `config.masks`; raises ConfigError for an unknown name."""
    return _create("perception.masks", config.masks, MASK_GENERATORS, "uppm.masks", config)


def check_profile(name: str) -> None:
    """Raise ConfigError unless there is such a profile."""
    _target("perception.profile", name, SEGMENTERS, "uppm.perception")


def models_of(config: PerceptionConfig) -> list[str]:
    """Names of the models (`uppm models list`) that a configuration's back ends load; plug-ins load their own."""
    parts = ((config.captioner, config.captioner_model), (config.detector, config.detector_model))
    parts += ((config.masks, config.masks_model), (config.profile, config.segmenter_model))
    parts += ((config.visual_feature, config.visual_feature_model),)
    known = {spec.back_end for spec in MODELS.values()}
    return [model_of(back_end, model) for back_end, model in parts if back_end in known]


def model_of(back_end: str, model: str | None) -> str:
    """The model that a back end loads: the one that is set, else its first in the table.

    Raises
    ------
    ConfigError
        There is no such model, or it is another back end's.
    """
    known = [spec.name for spec in MODELS.values() if spec.back_end == back_end]
    name = known[0] if model is None else model_spec(model).name
    if name not in known:
        expected, advice = f"one of {', '.join(known)}", f"correct it, or leave it out for {known[0]}"
        raise ConfigError(f"model of {back_end}", expected=expected, found=repr(name), advice=advice)
    return name


def _create(setting: str, name: str, table: Mapping[str, str], group: str, config: PerceptionConfig) -> Any:
    module, _, attribute = _target(setting, name, table, group).partition(":")
    try:
        back_end = getattr(import_module(module), attribute)
    except ImportError as error:
        if error.name not in TORCH:
            raise
        raise missing_torch(error) from None
    return back_end(config)


def _target(setting: str, name: str, table: Mapping[str, str], group: str) -> str:
    """Where a back end's class is; raises ConfigError with the names that there are."""
    known = {**{point.name: point.value for point in entry_points(group=group)}, **table}
    if name not in known:
        names = ", ".join(sorted(known))
        raise ConfigError(setting, expected=f"one of {names}", found=repr(name), advice="correct the name")
    return known[name]
