"""RAM++ against numbers that its own code computed with the same weights, with its own tags and with others."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tests.perception.captioners import seeded
from uppm.core.config import PerceptionConfig
from uppm.core.errors import InputError, UppmError
from uppm.perception.models.network import COMMAND

torch = pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)

from uppm.perception.captioners import ram_plus  # noqa: E402  # needs torch
from uppm.perception.captioners.tag_list import read_descriptions  # noqa: E402

DATA = Path(__file__).parent / "data"
NAME, FILE = "ram-plus-swin-l", "ram_plus_swin_large_14m.pth"
SIZES = {"swin": seeded.SWIN, "tagging": seeded.TAGGING, "tags": 40, "descriptions": 5}
SEEDS = (1, 2)


def golden(name: str, seed: int) -> npt.NDArray[Any]:
    with np.load(DATA / "ram_plus.npz") as data:
        return data[f"{name}{seed}"]


@pytest.fixture
def folder(models: Path) -> Path:
    return write_checkpoint(models)


def write_checkpoint(models: Path) -> Path:
    """A folder as the published one, with the tiny network's weights and forty tags."""
    folder = seeded.write_folder(models, NAME, SIZES)
    size = ram_plus.read_architecture(folder, ram_plus.RamPlusSize())
    network = ram_plus.RamPlusNetwork(size)
    weights = seeded.seeded_weights({k: tuple(v.shape) for k, v in network.state_dict().items()})
    torch.save({"model": {k: torch.from_numpy(np.asarray(v)) for k, v in weights.items()}}, folder / FILE)
    (folder / "tags.txt").write_text("".join(f"tag {i}\n" for i in range(40)))
    (folder / "thresholds.txt").write_text("".join(f"{0.4 + 0.01 * (i % 20)}\n" for i in range(40)))
    return folder


def test_names_and_shapes_are_the_published_network_s() -> None:
    with torch.device("meta"):
        network = ram_plus.RamPlusNetwork(ram_plus.RamPlusSize())
    own = {name: "x".join(map(str, tensor.shape)) for name, tensor in network.state_dict().items()}
    assert own == dict(line.split("\t") for line in (DATA / "ram_plus_names.tsv").read_text().splitlines())


@pytest.mark.parametrize("seed", SEEDS)
def test_tags_are_the_reference_s(folder: Path, seed: int) -> None:
    tagger = ram_plus.RamPlus(PerceptionConfig(captioner="ram_plus", threads=1))
    said = tagger.caption(seeded.frame(seed))
    assert (said.text, " | ".join(said.tags)) == ("", golden("tags", seed).item())
    tagger.close()


@pytest.mark.parametrize("seed", SEEDS)
def test_logits_of_its_own_and_of_other_tags_are_the_reference_s(folder: Path, seed: int) -> None:
    network, _ = ram_plus.load(ram_plus.Weights(name=NAME, folder=folder))
    image = torch.from_numpy(ram_plus.square_image(seeded.image(seed), 64))
    others = torch.from_numpy(np.random.default_rng(7).standard_normal((6, 3, 512)).astype(np.float32))
    with torch.inference_mode():
        np.testing.assert_allclose(network(image), golden("logits", seed), atol=2e-4)
        np.testing.assert_allclose(network(image, others), golden("open_logits", seed), atol=2e-4)


def test_a_list_of_one_s_own_is_embedded_by_clip(folder: Path, models: Path, tmp_path: Path) -> None:
    write_clip(models / "clip-vit-base-patch16")
    (tmp_path / "own.txt").write_text("lab bench\n\nfume hood\n")
    tagger = ram_plus.RamPlus(PerceptionConfig(captioner="ram_plus", tag_list=tmp_path / "own.txt", threads=1))
    assert set(tagger.caption(seeded.frame(1)).tags) <= {"lab bench", "fume hood"}


def write_clip(folder: Path) -> None:
    """A tiny CLIP text tower and a tokenizer of letters."""
    from transformers import CLIPTextConfig, CLIPTextModelWithProjection

    sizes: dict[str, Any] = {
        "hidden_size": 16,
        "intermediate_size": 32,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
    }
    letters = [*"abcdefghijklmnopqrstuvwxyz.", *(f"{c}</w>" for c in "abcdefghijklmnopqrstuvwxyz.")]
    vocabulary = {token: i for i, token in enumerate([*letters, "<|startoftext|>", "<|endoftext|>"])}
    ends: dict[str, Any] = {"bos_token_id": len(vocabulary) - 2, "eos_token_id": len(vocabulary) - 1}
    config = CLIPTextConfig(vocab_size=len(vocabulary), projection_dim=512, **sizes, **ends)
    CLIPTextModelWithProjection(config).save_pretrained(folder)
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")


@pytest.mark.parametrize(
    ("name", "text", "tags"),
    [
        ("a.txt", "mug\n  kettle \n\n", {"mug": ["a photo of a mug."], "kettle": ["a photo of a kettle."]}),
        (
            "b.json",
            '[{"mug": ["a cup", "round"]}, {"kettle": ["hot", "steel"]}]',
            {"mug": ["a cup", "round"], "kettle": ["hot", "steel"]},
        ),
    ],
)
def test_both_forms_of_a_tag_list(tmp_path: Path, name: str, text: str, tags: dict[str, list[str]]) -> None:
    (tmp_path / name).write_text(text)
    assert read_descriptions(tmp_path / name) == tags


@pytest.mark.parametrize("text", ["", "{", "[3]", '[{"mug": ["a"]}, {"cup": ["a", "b"]}]', '[{"mug": [1]}]', "[]"])
def test_a_list_that_is_none_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "tags.json").write_text(text)
    with pytest.raises(InputError, match=r"tags\.json: expected .* see docs/models\.md"):
        read_descriptions(tmp_path / "tags.json")
    with pytest.raises(InputError, match=r"none\.txt: expected a list of tags"):
        read_descriptions(tmp_path / "none.txt")


def test_lists_of_another_length_are_named(folder: Path) -> None:
    tagger = ram_plus.RamPlus(PerceptionConfig(captioner="ram_plus", threads=1))
    (folder / "thresholds.txt").write_text("0.5\nhalf\n")
    with pytest.raises(UppmError, match=r"thresholds\.txt: expected 40 numbers, one a line, found could not convert"):
        tagger.caption(seeded.frame(1))
