"""Tag2Text against numbers that its own code computed with the same weights, and its checkpoint's names and shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tests.perception.captioners import seeded
from uppm.core.config import PerceptionConfig
from uppm.core.errors import InputError
from uppm.perception.models.network import COMMAND
from uppm.perception.registry import CAPTIONERS

torch = pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)

from uppm.perception.captioners import tag2text  # noqa: E402  # needs torch
from uppm.perception.captioners.beam import BeamOptions  # noqa: E402
from uppm.perception.captioners.checkpoint import square_image  # noqa: E402
from uppm.perception.models.network import Weights  # noqa: E402

DATA = Path(__file__).parent / "data"
NAME = "tag2text-swin-b"
SEEDS = (1, 2)
SIZES = {"swin": seeded.SWIN, "text": seeded.TEXT, "tagging": seeded.TAGGING}


def golden(name: str, seed: int) -> npt.NDArray[Any]:
    with np.load(DATA / "tag2text.npz") as data:
        return data[f"{name}{seed}"]


def write_checkpoint(root: Path, state: dict[str, Any] | None = None) -> Path:
    """A folder as the published one, with the tiny network's weights, and what training leaves in a checkpoint."""
    folder = seeded.write_folder(root, NAME, SIZES)
    if state is None:
        size = tag2text.read_architecture(folder, tag2text.Tag2TextSize())
        with torch.device("meta"):
            shapes = {k: tuple(v.shape) for k, v in tag2text.Tag2TextNetwork(size).state_dict().items()}
        state = {k: torch.from_numpy(np.asarray(v)) for k, v in seeded.seeded_weights(shapes).items()}
        state["visual_encoder.layers.0.blocks.0.attn.relative_position_index"] = torch.zeros(16, 16)
        state["visual_encoder.layers.0.blocks.1.attn_mask"] = torch.zeros(16, 16, 16)
        state["tag_encoder.embeddings.position_ids"] = torch.arange(64)[None]
    torch.save(
        {"model": state, "optimizer": {"step": 3}, "config": {"lr": 1e-4}, "epoch": 1}, folder / "tag2text_swin_14m.pth"
    )
    return folder


@pytest.fixture
def folder(models: Path) -> Path:
    return write_checkpoint(models)


@pytest.mark.parametrize(
    ("file", "make"), [("tag2text_names.tsv", lambda: tag2text.Tag2TextNetwork(tag2text.Tag2TextSize()))]
)
def test_names_and_shapes_are_the_published_network_s(file: str, make: Any) -> None:
    with torch.device("meta"):
        own = {name: "x".join(map(str, tensor.shape)) for name, tensor in make().state_dict().items()}
    published = dict(line.split("\t") for line in (DATA / file).read_text().splitlines())
    assert own == published


@pytest.mark.parametrize("seed", SEEDS)
def test_each_stage_is_the_reference_s(folder: Path, seed: int) -> None:
    network, vocabulary = tag2text.load(Weights(name=NAME, folder=folder))
    with torch.inference_mode():
        seen = network.visual_encoder(torch.from_numpy(square_image(seeded.image(seed), 64)))
        np.testing.assert_allclose(seen, golden("seen", seed), atol=2e-5)
        logits = network.tag_logits(seen)[0].numpy()
        np.testing.assert_allclose(logits, golden("logits", seed), atol=1e-4)
        tags = vocabulary.applying(logits)
        assert " | ".join(tags) == golden("tags", seed).item()
        ids, mask = vocabulary.words.tags(tags)
        np.testing.assert_array_equal(ids, golden("ids", seed))
        np.testing.assert_array_equal(mask, golden("mask", seed))
        source = network.tag_encoder.encode(torch.from_numpy(ids[None]), torch.from_numpy(mask[None]), seen)
        np.testing.assert_allclose(source, golden("encoded", seed), atol=1e-4)
        decoder, prompt = network.text_decoder, torch.tensor([vocabulary.words.prompt(tag2text.PROMPT)])
        states, _ = decoder.bert.decode(prompt, decoder.bert.sources(source), [])
        np.testing.assert_allclose(decoder.cls(states), golden("words", seed), atol=1e-4)
        # Word by word, as captions are written, it is the same.
        cache: Any = []
        for i in range(prompt.shape[1]):
            states, cache = decoder.bert.decode(prompt[:, i : i + 1], decoder.bert.sources(source), cache)
            np.testing.assert_allclose(decoder.cls(states)[:, 0], golden("words", seed)[:, i], atol=1e-4)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("beams", "name"), [(3, "caption"), (1, "greedy")])
def test_captions_and_tags_are_the_reference_s(folder: Path, seed: int, beams: int, name: str) -> None:
    captioner = tag2text.Tag2Text(PerceptionConfig(captioner="tag2text", caption_beams=beams, threads=1))
    said = captioner.caption(seeded.frame(seed))
    assert said.text == golden(name, seed).item()
    assert " | ".join(said.tags) == golden("tags", seed).item()
    captioner.close()


@pytest.mark.parametrize(("use_tags", "writes"), [(True, False), (False, True)])
def test_without_captions_the_tags_alone_are_asked_for(folder: Path, use_tags: bool, writes: bool) -> None:
    """Unless the tags are not used either."""
    settings = {"captioner": "tag2text", "use_captions": False, "use_tags": use_tags, "threads": 1}
    said = tag2text.Tag2Text(PerceptionConfig.model_validate(settings)).caption(seeded.frame(SEEDS[0]))
    assert bool(said.text) is writes
    assert " | ".join(said.tags) == golden("tags", SEEDS[0]).item()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_caption_that_does_not_end_is_the_reference_s(folder: Path, seed: int) -> None:
    network, vocabulary = tag2text.load(Weights(name=NAME, folder=folder))
    options = BeamOptions(end=vocabulary.words.end, min_length=50)
    with torch.inference_mode():
        ids = network.write(
            torch.from_numpy(golden("encoded", seed)), vocabulary.words.prompt(tag2text.PROMPT), options
        )
    assert len(ids) == 50
    assert vocabulary.words.text(ids)[len(tag2text.PROMPT) :] == golden("long", seed).item()


def test_a_checkpoint_with_other_names_or_shapes_is_refused_by_key(folder: Path, models: Path) -> None:
    state = torch.load(folder / "tag2text_swin_14m.pth", weights_only=True)["model"]
    state["fc.bias"] = state.pop("fc.b")
    state["label_embed.weight"] = state["label_embed.weight"][:-1]
    write_checkpoint(models, state)
    with pytest.raises(InputError) as caught:
        tag2text.load(Weights(name=NAME, folder=folder))
    assert caught.value.found == "keys: 1 missing (fc.b); 1 unexpected (fc.bias); 1 mismatched (label_embed.weight)"


def test_the_tagging_head_s_old_name_is_known(folder: Path, models: Path) -> None:
    state = torch.load(folder / "tag2text_swin_14m.pth", weights_only=True)["model"]
    write_checkpoint(models, {key.replace("tagging_head", "vision_multi"): value for key, value in state.items()})
    loaded = tag2text.load(Weights(name=NAME, folder=folder))
    assert loaded is not None


@pytest.mark.parametrize("content", [b"", b"no checkpoint", b"PK\x03\x04"])
def test_a_file_that_is_no_checkpoint(folder: Path, content: bytes) -> None:
    (folder / "tag2text_swin_14m.pth").write_bytes(content)
    with pytest.raises(
        InputError, match=r"tag2text_swin_14m\.pth: expected a checkpoint with the weights under `model`"
    ):
        tag2text.load(Weights(name=NAME, folder=folder))


def test_a_vocabulary_of_another_size(folder: Path, models: Path) -> None:
    (models / "bert-base-uncased" / "vocab.txt").write_text("[PAD]\n[CLS]\n[SEP]\n[UNK]\na\n")
    with pytest.raises(InputError, match=r"expected 90 tokens, one a line, .* found 5 lines"):
        tag2text.load(Weights(name=NAME, folder=folder))


def test_many_tags_are_cut_and_none_is_possible(folder: Path) -> None:
    words = tag2text.load(Weights(name=NAME, folder=folder))[1].words
    ids, mask = words.tags(["table"] * 60)
    assert (len(ids), mask.all(), ids[-1]) == (40, True, words.end)
    ids, mask = words.tags([])
    assert (int(mask.sum()), ids[1]) == (2, words.end)


def test_it_is_named_in_the_registry() -> None:
    assert CAPTIONERS["tag2text"] == f"{tag2text.__name__}:Tag2Text"
