"""Prompted detectors on tiny random weights: they give what transformers gives, and prompts do not interfere."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tests.perception.foundation import tiny
from tests.perception.foundation.conftest import labels
from uppm.core.config import PerceptionConfig
from uppm.core.protocols import Detector
from uppm.core.types import Detections, Frame, Provenance
from uppm.perception.registry import create_detector
from uppm.perception.segmentation import grounding_dino
from uppm.perception.segmentation.grounding_dino import GroundingDino
from uppm.perception.segmentation.prompts import pack, phrases

DINOS = ("grounding_dino", "mm_grounding_dino")
OWLS = {"owlv2": "Owlv2", "owlvit": "OwlViT"}
TEXTS = ("red cup", "chair", "cup of coffee", "chandelier", "wooden box")
Models = Callable[[str], Path]


def detector(kind: str, **settings: Any) -> Detector:
    every = {"detector_score": 0.0, "text_score": 0.0, "threads": 1} | settings
    return create_detector(PerceptionConfig(detector=kind, detector_model=tiny.NAMES[kind], **every))


def of(found: Detections, text: str) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    rows = [i for i, label in enumerate(found.labels) if label.text == text]
    return found.scores[rows], found.boxes[rows]


@pytest.mark.parametrize("kind", DINOS)
def test_one_phrase_gives_what_transformers_gives(models: Models, picture: Frame, kind: str) -> None:
    folder = models(kind)
    torch, t = tiny.torch_or_skip()
    name = "GroundingDino" if kind == "grounding_dino" else "MMGroundingDino"
    tokenizer = t.AutoTokenizer.from_pretrained(folder)
    image = t.GroundingDinoImageProcessorPil.from_pretrained(folder)
    processor = t.GroundingDinoProcessor(image_processor=image, tokenizer=tokenizer)
    model = getattr(t, f"{name}ForObjectDetection").from_pretrained(folder).eval()
    found = detector(kind).detect(picture.color, labels(*TEXTS))
    for text in TEXTS:
        inputs = processor(images=picture.color, text=[[text]], return_tensors="pt")
        with torch.no_grad():
            out = model(**inputs)
        (theirs,) = processor.post_process_grounded_object_detection(
            out, inputs.input_ids, threshold=-1.0, target_sizes=[picture.color.shape[:2]]
        )
        # The phrase's own tokens: all between [CLS] and the full stop.
        scores = out.logits[0, :, 1 : inputs.input_ids.shape[1] - 2].sigmoid().amax(dim=1)
        order = torch.argsort(scores, descending=True, stable=True)
        ours = of(found, text)
        np.testing.assert_allclose(ours[0], scores[order].numpy(), atol=1e-5)
        limits = np.array([64, 48, 64, 48])
        np.testing.assert_allclose(ours[1], np.clip(theirs["boxes"][order].numpy(), 0, limits), atol=1e-2)


@pytest.mark.parametrize("kind", [*DINOS, *OWLS])
def test_no_label_changes_what_is_found_of_another(models: Models, picture: Frame, kind: str) -> None:
    """Permuted, split in two, and beside another label: the same to the bit (OWL: to rounding)."""
    models(kind)
    some, tolerance = detector(kind), 1e-5 if kind in OWLS else 0
    whole = some.detect(picture.color, labels(*TEXTS))
    assert len(set(whole.labels)) == len(TEXTS)
    shuffled = list(TEXTS)
    random.Random(1).shuffle(shuffled)
    parts = [shuffled, shuffled[:2], shuffled[2:], [TEXTS[1], "book"]]
    for part in parts:
        found = some.detect(picture.color, labels(*part))
        for text in set(part) & set(TEXTS):
            for ours, before in zip(of(found, text), of(whole, text), strict=True):
                np.testing.assert_allclose(ours, before, atol=tolerance)


def test_rows_taken_together_give_what_each_gives_alone(
    models: Models, picture: Frame, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a GPU: several texts of one length in a batch, one image for all."""
    models("grounding_dino")
    alone = detector("grounding_dino").detect(picture.color, labels(*TEXTS, "door", "floor", "blue mug"))
    monkeypatch.setattr(grounding_dino, "CPU_ROWS", 3)
    together = detector("grounding_dino").detect(picture.color, labels(*TEXTS, "door", "floor", "blue mug"))
    for text in {label.text for label in alone.labels}:
        for ours, before in zip(of(together, text), of(alone, text), strict=True):
            np.testing.assert_allclose(ours, before, atol=1e-4)


@pytest.mark.parametrize("kind", DINOS)
def test_joint_prompts_do_not_depend_on_the_order(models: Models, picture: Frame, kind: str) -> None:
    models(kind)
    some = detector(kind, prompts="joint")
    whole = some.detect(picture.color, labels(*TEXTS))
    again = some.detect(picture.color, labels(*reversed(TEXTS)))
    assert whole.labels == again.labels
    np.testing.assert_array_equal(whole.boxes, again.boxes)
    np.testing.assert_array_equal(whole.scores, again.scores)
    # They do depend on the other labels, which is why `separate` is the default.
    alone = some.detect(picture.color, labels("chair"))
    assert np.abs(of(alone, "chair")[0] - of(whole, "chair")[0]).max() > 1e-3


def test_more_labels_than_a_text_holds_are_all_asked_for(models: Models, picture: Frame) -> None:
    models("grounding_dino")
    texts = [f"{a} {b} {c}" for a in ("red", "blue", "the") for b in ("cup", "mug", "book", "box") for c in "123456789"]
    found = detector("grounding_dino", prompts="joint").detect(picture.color, labels(*texts))
    assert {label.text for label in found.labels} == set(texts)


def test_a_box_that_only_the_adjective_speaks_for_is_none() -> None:
    """Scores of two queries for [CLS] red cup . door . [SEP] by hand; box threshold 0.35, text threshold 0.25."""
    tiny.torch_or_skip()
    some = phrases(labels("red cup", "door"), lambda word: [len(word)])
    (row,) = pack(some, 101, 1012, 102, max_tokens=256, together=True)
    by_word = {"door": (0.1, 0.36), "red": (0.9, 0.9), "cup": (0.2, 0.3)}
    scores = np.full((2, len(row.tokens)), 0.99, dtype=np.float32)
    for phrase, start in zip(row.phrases, row.starts, strict=True):
        for i, word in enumerate(phrase.label.text.split()):
            scores[:, start + i] = by_word[word]
    boxes = np.arange(8, dtype=np.float32).reshape(2, 4)
    found = list(GroundingDino(PerceptionConfig(detector="grounding_dino"))._read(row, scores, boxes))
    assert [(label.text, round(score, 2), box.tolist()) for label, score, box in found] == [
        ("door", 0.36, [4, 5, 6, 7]), ("red cup", 0.9, [4, 5, 6, 7]),
    ]  # fmt: skip


@pytest.mark.parametrize("kind", [*DINOS, *OWLS])
def test_labels_keep_their_provenance_and_thresholds_count(models: Models, picture: Frame, kind: str) -> None:
    models(kind)
    mixed = (*labels("Cup", provenance=Provenance.TAG), *labels("cup"), *labels("door", provenance=Provenance.TAG))
    found = detector(kind).detect(picture.color, mixed)
    assert {(label.text, label.provenance.value) for label in found.labels} == {("cup", "caption"), ("door", "tag")}
    assert (np.diff(found.scores) <= 0).all()
    least = float(np.median(found.scores))
    fewer = detector(kind, detector_score=least).detect(picture.color, mixed)
    np.testing.assert_array_equal(fewer.scores, found.scores[found.scores > least])
    assert detector(kind).detect(picture.color, ()).boxes.shape == (0, 4)
    assert detector(kind, detector_score=1.0).detect(picture.color, mixed).labels == ()


@pytest.mark.parametrize("kind", OWLS)
def test_an_owl_gives_what_transformers_gives(models: Models, picture: Frame, kind: str) -> None:
    folder = models(kind)
    torch, t = tiny.torch_or_skip()
    name = OWLS[kind]
    image = getattr(t, f"{name}ImageProcessorPil").from_pretrained(folder)
    processor = getattr(t, f"{name}Processor")(image_processor=image, tokenizer=t.AutoTokenizer.from_pretrained(folder))
    model = getattr(t, f"{name}ForObjectDetection").from_pretrained(folder).eval()
    found = detector(kind).detect(picture.color, labels("chair", "red cup"))
    # OWLv2's to the padded square, whose side is the longer one's; OWL-ViT's to the image itself.
    size = (64, 64) if kind == "owlv2" else (48, 64)
    for text in ("chair", "red cup"):
        inputs = processor(images=picture.color, text=[[f"a photo of a {text}"]], return_tensors="pt", max_length=32)
        with torch.no_grad():
            out = model(**inputs)
        (theirs,) = processor.post_process_grounded_object_detection(out, threshold=-1.0, target_sizes=[size])
        order = torch.argsort(theirs["scores"], descending=True, stable=True)
        ours = of(found, text)
        np.testing.assert_allclose(ours[0], theirs["scores"][order].numpy(), atol=1e-5)
        boxes = np.clip(theirs["boxes"][order].numpy(), 0, [64, 48, 64, 48])
        np.testing.assert_allclose(np.sort(ours[1], axis=0), np.sort(boxes, axis=0), atol=1e-2)


def test_a_prompt_is_read_once(models: Models, picture: Frame, monkeypatch: pytest.MonkeyPatch) -> None:
    models("owlvit")
    _, t = tiny.torch_or_skip()
    read, original = list[int](), t.OwlViTModel.get_text_features

    def counted(self: Any, input_ids: Any, **given: Any) -> Any:
        read.append(len(input_ids))
        return original(self, input_ids=input_ids, **given)

    monkeypatch.setattr(t.OwlViTModel, "get_text_features", counted)
    some = detector("owlvit")
    for texts in (("chair", "cup"), ("cup", "chair"), ("chair", "red cup", "cup")):
        assert {label.text for label in some.detect(picture.color, labels(*texts)).labels} == set(texts)
    assert read == [2, 1]
