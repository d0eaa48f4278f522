"""Panoptic networks on tiny random weights: what transformers' own code gives; label maps; SAM 3."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.perception.foundation import tiny
from tests.perception.foundation.conftest import labels
from uppm.core.categories import category_by_name
from uppm.core.config import PerceptionConfig
from uppm.core.types import Frame, PanopticSegmentation
from uppm.perception.registry import create_segmenter
from uppm.perception.segmentation import sam3
from uppm.perception.segmentation.panoptic import unified_name
from uppm.perception.segmentation.square_input import square_input

Models = Callable[[str], Path]
COCO_PANOPTIC_STUFF = """
banner blanket bridge cardboard counter curtain door-stuff floor-wood flower fruit gravel house light mirror-stuff net
pillow platform playingfield railroad river road roof sand sea shelf snow stairs tent towel wall-brick wall-stone
wall-tile wall-wood water-other window-blind window-other tree-merged fence-merged ceiling-merged sky-other-merged
cabinet-merged table-merged floor-other-merged pavement-merged mountain-merged grass-merged dirt-merged paper-merged
food-other-merged building-other-merged rock-merged wall-other-merged rug-merged
"""


def segment(kind: str, frame: Frame, *texts: str, **settings: Any) -> PanopticSegmentation:
    every = {"detector_score": 0.0, "min_mask_pixels": 1, "threads": 1} | settings
    config = PerceptionConfig.model_validate({"profile": kind, "segmenter_model": tiny.NAMES[kind], **every})
    return create_segmenter(config).segment(frame, labels(*texts))


def reference(kind: str, folder: Path, frame: Frame) -> tuple[Any, dict[int, str]]:
    """What transformers' processor, network and post-processing give, without fusing."""
    torch, t = tiny.torch_or_skip()
    if kind == "mask2former":
        processor = t.Mask2FormerImageProcessorPil.from_pretrained(folder)
        inputs = processor(frame.color, return_tensors="pt")
        model = t.Mask2FormerForUniversalSegmentation.from_pretrained(folder).eval()
    else:
        image = t.OneFormerImageProcessorPil.from_pretrained(folder)
        tokenizer = t.AutoTokenizer.from_pretrained(folder)
        whole = t.OneFormerProcessor(image_processor=image, tokenizer=tokenizer, task_seq_length=24)
        inputs = whole(frame.color, ["panoptic"], return_tensors="pt")
        model = t.OneFormerForUniversalSegmentation.from_pretrained(folder).eval()
        processor = t.Mask2FormerImageProcessorPil()
    with torch.no_grad():
        out = model(**inputs)
    (result,) = processor.post_process_panoptic_segmentation(
        out, threshold=0.0, label_ids_to_fuse=set(), target_sizes=[frame.depth.shape]
    )
    return result, model.config.id2label


@pytest.mark.parametrize("kind", ["mask2former", "oneformer"])
def test_segments_are_what_transformers_gives(models: Models, picture: Frame, kind: str) -> None:
    theirs, names = reference(kind, models(kind), picture)
    ours = segment(kind, picture)
    assert theirs["segments_info"]
    ids = theirs["segmentation"].numpy()
    expected: dict[tuple[str, int], np.ndarray] = {}
    for info in theirs["segments_info"]:
        name = unified_name(names[info["label_id"]])
        # Stuff of one name is one segment; things stay apart.
        key = (name, info["id"] if category_by_name()[name].is_thing else 0)
        expected[key] = expected.get(key, False) | (ids == info["id"])
    found = [(s.label.text, ours.ids == i) for i, s in enumerate(ours.segments, 1)]
    assert sorted(text for text, _ in found) == sorted(text for text, _ in expected)
    for text, mask in found:
        assert any(name == text and (mask != other).mean() < 1e-3 for (name, _), other in expected.items())
    assert all(s.is_thing == category_by_name()[s.label.text].is_thing for s in ours.segments)


def test_every_class_of_coco_panoptic_is_a_unified_category() -> None:
    known = category_by_name()
    names = COCO_PANOPTIC_STUFF.split()
    found = {unified_name(name) for name in names}
    assert len(names) == 53
    assert found <= set(known)
    assert not any(known[name].is_thing for name in found)
    assert unified_name("wall-other-merged") == "wall-other"
    assert unified_name("ceiling-merged") == "ceiling-other"
    # ADE20K's synonyms, and what no table knows.
    assert unified_name("bed ") == "bed"
    assert unified_name("chest of drawers, chest, bureau") == "chest of drawers"


def test_sam3_gives_what_transformers_gives(models: Models, picture: Frame) -> None:
    """From our input on: their processor asks for torchvision."""
    folder = models("sam3")
    torch, t = tiny.torch_or_skip()
    model = t.Sam3Model.from_pretrained(folder).eval()
    tokens = t.AutoTokenizer.from_pretrained(folder)(
        "red cup", padding="max_length", max_length=32, return_tensors="pt"
    )
    pixels = torch.from_numpy(square_input(picture.color, 112, sam3.MEAN, sam3.STD))
    with torch.no_grad():
        out = model(pixel_values=pixels, input_ids=tokens.input_ids, attention_mask=tokens.attention_mask)
    scores = (out.pred_logits.sigmoid() * out.presence_logits.sigmoid())[0]
    best = int(scores.argmax())
    mask = torch.nn.functional.interpolate(out.pred_masks.sigmoid(), (48, 64), mode="bilinear")[0, best] > 0.5
    least = float(scores[best]) - 1e-5
    ours = segment("sam3", picture, "red cup", detector_score=least, depth_edges="keep")
    (only,) = ours.segments
    assert only.label.text == "red cup"
    assert only.score == pytest.approx(float(scores[best]), abs=1e-5)
    assert ((ours.ids == 1) != mask.numpy()).mean() < 1e-3


def test_sam3_without_labels_or_hits_finds_nothing(models: Models, picture: Frame) -> None:
    models("sam3")
    assert segment("sam3", picture).segments == ()
    assert segment("sam3", picture, "cup", detector_score=1.0).segments == ()
