"""What closed-set panoptic networks share: their label maps, and their queries' masks made into one segmentation."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from uppm.core.categories import category_by_name
from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame, Label, PanopticSegmentation, Provenance, Segment
from uppm.perception.segmentation.assembly import Mask, assemble
from uppm.perception.segmentation.prompted import is_surface

SCORE = 0.5
"""Least class probability of a query."""


def unified_name(name: str) -> str:
    """The unified category that a class of COCO panoptic is, else the name as it is.

    COCO panoptic merged some of COCO-Stuff's classes: `wall-other-merged` holds wall-concrete, wall-panel and
    wall-other, `ceiling-merged` both ceilings. ADE20K lists synonyms, of which the first is taken.
    """
    plain = name.split(",")[0].strip().removesuffix("-merged")
    known = category_by_name()
    return plain if plain in known else f"{plain}-other" if f"{plain}-other" in known else plain


def to_segmentation(frame: Frame, config: PerceptionConfig, out: Any, names: Mapping[int, str]) -> PanopticSegmentation:
    """One segmentation from the class and mask logits of a network's queries.

    The queries are decoded by transformers, with Mask2Former's code for OneFormer too, whose own asks for torchvision.
    Stuff is fused here: their own fusing gives the ids of segments before it out again.
    """
    from transformers import Mask2FormerImageProcessorPil

    logits = SimpleNamespace(
        class_queries_logits=out.class_queries_logits.float(), masks_queries_logits=out.masks_queries_logits.float()
    )
    (result,) = Mask2FormerImageProcessorPil().post_process_panoptic_segmentation(
        logits,
        threshold=SCORE if config.detector_score is None else config.detector_score,
        label_ids_to_fuse=set(),
        target_sizes=[frame.depth.shape],
    )
    ids = result["segmentation"].cpu().numpy()
    things: list[tuple[Mask, Segment]] = []
    stuff: dict[str, tuple[Mask, Segment]] = {}
    for info in result["segments_info"]:
        text, mask = unified_name(names[info["label_id"]]), ids == info["id"]
        category = category_by_name().get(text)
        is_thing = category.is_thing if category else not is_surface(text)
        label = Label(text=text, provenance=Provenance.DETECTOR)
        segment = Segment(label=label, score=float(np.clip(info["score"], 0, 1)), is_thing=is_thing)
        if is_thing:
            things.append((mask, segment))
        else:
            before, best = stuff.get(text, (mask, segment))
            stuff[text] = before | mask, max(best, segment, key=lambda s: s.score)
    return assemble(frame, [*things, *stuff.values()], config.min_mask_pixels)
