"""Florence-2 with tiny random weights, loaded as the hub has them, against transformers' own processor and network."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from tokenizers.pre_tokenizers import ByteLevel

from tests.perception.captioners import seeded
from uppm.core.config import Config, PerceptionConfig
from uppm.core.types import Provenance
from uppm.perception.fakes import FakeRetriever
from uppm.perception.models.network import COMMAND
from uppm.pipeline import Mapper

torch = pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)
transformers: Any = pytest.importorskip("transformers", reason=f"transformers is not installed: {COMMAND}")

from uppm.perception.captioners import florence2  # noqa: E402  # needs torch


@pytest.fixture
def folder(models: Path) -> Path:
    return write_checkpoint(models)


def write_checkpoint(models: Path, name: str = "florence-2-base") -> Path:
    """Florence-2 of one layer a stage on images of 64 pixels a side, over bytes and places."""
    folder = models / name
    folder.mkdir()
    processor = write_processor(folder)
    words = processor.tokenizer
    ends = {name: getattr(words, name) for name in ("bos_token_id", "eos_token_id", "pad_token_id")}
    sizes = {"d_model": 32, "encoder_ffn_dim": 32, "decoder_ffn_dim": 32, "max_position_embeddings": 320}
    heads = {"encoder_attention_heads": 2, "decoder_attention_heads": 2, "encoder_layers": 1, "decoder_layers": 1}
    start = {"decoder_start_token_id": words.eos_token_id, "forced_eos_token_id": words.eos_token_id}
    stages = {"embed_dim": [8, 16, 16, 32], "num_heads": [1, 2, 2, 2], "num_groups": [1, 2, 2, 2], "window_size": 4}
    config = transformers.Florence2Config(
        text_config={"model_type": "bart", "vocab_size": len(words), **sizes, **heads, **ends, **start},
        vision_config={**stages, "depths": [1, 1, 1, 1], "projection_dim": 32},
        image_token_id=words.image_token_id,
        **ends,
    )
    torch.manual_seed(3)
    network = transformers.Florence2ForConditionalGeneration(config)
    for parameter in network.parameters():
        if parameter.ndim > 1:
            torch.nn.init.normal_(parameter, std=0.4)
    network.save_pretrained(folder)
    return folder


def write_processor(folder: Path) -> Any:
    """A tokenizer of bytes without merges, with the thousand places that Florence-2 counts in each direction."""
    letters = sorted(ByteLevel.alphabet())
    vocabulary = {token: i for i, token in enumerate(["<s>", "<pad>", "</s>", "<unk>", *letters, "<mask>"])}
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    words = transformers.BartTokenizer.from_pretrained(folder, extra_special_tokens={"image_token": "<image>"})
    words.add_tokens([f"<loc_{i}>" for i in range(1000)])
    images = transformers.CLIPImageProcessorPil(size={"height": 64, "width": 64}, do_center_crop=False)
    images.image_seq_length = 5  # two by two places at a stride of 32, and their mean
    parsing: dict[str, Any] = {"pure_text": {}, "description_with_bboxes": {}}  # as the published folder has them
    processor = transformers.Florence2Processor(images, words, post_processor_config=parsing)
    processor.save_pretrained(folder)
    return processor


def reference(folder: Path, task: str, beams: int) -> Any:
    """The answer by transformers alone."""
    frame = seeded.frame(1)
    processor = transformers.Florence2Processor.from_pretrained(folder, backend="pil")
    network = transformers.Florence2ForConditionalGeneration.from_pretrained(folder).eval()
    inputs = processor(text=task, images=frame.color, return_tensors="pt")
    with torch.inference_mode():
        ids = network.generate(**inputs, max_new_tokens=florence2.MAX_TOKENS, num_beams=beams, do_sample=False)
    said = processor.batch_decode(ids, skip_special_tokens=False)[0]
    return processor.post_process_generation(said, task=task, image_size=(64, 64))[task]


def test_caption_and_labels_are_the_library_s(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(florence2, "MAX_TOKENS", 24)
    settings = {"captioner": "florence2", "captioner_model": "florence-2-base", "caption_beams": 2, "threads": 1}
    captioner = florence2.Florence2(PerceptionConfig.model_validate(settings))
    said = captioner.caption(seeded.frame(1))
    assert said.text == reference(folder, florence2.CAPTION, 2)
    assert said.text
    labels = reference(folder, florence2.REGIONS, 2)["labels"]
    assert said.tags == tuple(dict.fromkeys(label for label in labels if label))
    captioner.close()


def test_regions_are_read_as_labels(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {"captioner": "florence2", "captioner_model": "florence-2-base", "threads": 1}
    captioner = florence2.Florence2(PerceptionConfig.model_validate(settings))
    said = (
        "</s><s>red chair<loc_1><loc_2><loc_3><loc_4>mug<loc_5><loc_6><loc_7><loc_8>mug<loc_0><loc_0><loc_9><loc_9></s>"
    )
    original = transformers.Florence2Processor.batch_decode
    spoken = lambda self, *a, **k: [said] if original(self, *a, **k) else []  # noqa: E731
    monkeypatch.setattr(transformers.Florence2Processor, "batch_decode", spoken)
    monkeypatch.setattr(florence2, "MAX_TOKENS", 4)
    assert captioner.caption(seeded.frame(1)).tags == ("red chair", "mug")


def test_what_it_says_of_a_picture_is_mapped(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The network runs; what its random weights answer is put into words."""
    said = "</s><s>red chair<loc_1><loc_2><loc_3><loc_4></s>"
    monkeypatch.setattr(transformers.Florence2Processor, "batch_decode", lambda self, ids, **k: [said] * len(ids))
    monkeypatch.setattr(florence2, "MAX_TOKENS", 4)
    settings = {"captioner": "florence2", "captioner_model": "florence-2-base", "use_captions": False, "threads": 1}
    segmenter = seeded.Noting()
    mapper = Mapper(Config.model_validate({"perception": settings}), segmenter=segmenter, retriever=FakeRetriever())
    mapper.integrate(seeded.frame(1))
    mapper.close()
    assert [(label.text, label.provenance) for label in segmenter.asked[0]] == [("red chair", Provenance.TAG)]
    assert [submap for submap in mapper.map.submaps if submap.descriptor]


@pytest.mark.parametrize(
    ("unused", "tasks"),
    [("use_tags", [florence2.CAPTION]), ("use_captions", [florence2.REGIONS])],
)
def test_what_is_not_used_is_not_asked_for(
    folder: Path, monkeypatch: pytest.MonkeyPatch, unused: str, tasks: list[str]
) -> None:
    asked: list[str] = []
    answers = {florence2.CAPTION: "a desk", florence2.REGIONS: {"labels": ["desk"]}}
    monkeypatch.setattr(florence2, "answer", lambda loaded, frame, task, beams: asked.append(task) or answers)
    settings = {"captioner": "florence2", "captioner_model": "florence-2-base", unused: False, "threads": 1}
    said = florence2.Florence2(PerceptionConfig.model_validate(settings)).caption(seeded.frame(1))
    assert asked == tasks
    assert (said.text, said.tags) == (("a desk", ()) if unused == "use_tags" else ("", ("desk",)))
