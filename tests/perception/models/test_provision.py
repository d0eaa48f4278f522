"""What a configuration needs is on this machine before its first frame, or one line says what to do."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.cli.room import write_room
from tests.perception.captioners import seeded
from tests.perception.foundation import tiny
from tests.perception.models.hub import FakeHub
from uppm import open_map
from uppm.cli.main import app
from uppm.core.config import PerceptionConfig
from uppm.core.errors import ConfigError, MissingExtraError, UppmError
from uppm.perception import provision
from uppm.perception.fakes import FakeTextEncoder
from uppm.perception.models.network import COMMAND
from uppm.perception.models.table import MODELS, MPNET, model_spec
from uppm.perception.provision import needed_models, provide

PAPER = ("tag2text-swin-b", "bert-base-uncased", "grounding-dino-tiny", "sam-vit-huge", MPNET)
"""What `--perception foundation` takes."""


@pytest.fixture(autouse=True)
def no_wheels(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty machine, without the wheels that bring the sentence embedder."""
    monkeypatch.setattr(provision, "unpack_wheels", lambda report: None)


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({}, []),
        ({"profile": "foundation"}, list(PAPER)),
        ({"profile": "foundation-light"}, ["owlvit-base-patch32", "sam2.1-hiera-tiny"]),
        ({"profile": "foundation-light", "tag_list": "own.txt"}, ["owlvit-base-patch32", "sam2.1-hiera-tiny", MPNET]),
        ({"captioner": "ram_plus", "tag_list": "own.txt"}, ["ram-plus-swin-l", "clip-vit-base-patch16", MPNET]),
        ({"profile": "mask2former", "visual_feature": "siglip"}, ["mask2former-swin-large", "siglip-base"]),
        ({"detector": "mine", "detector_model": "my own"}, []),
    ],
)
def test_needed_are_the_back_ends_models_and_the_embedder_of_new_words(settings: dict, names: list[str]) -> None:
    assert needed_models(PerceptionConfig.model_validate(settings)) == names


def test_offline_everything_that_is_missing_is_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    tiny.torch_or_skip()
    monkeypatch.setenv("UPPM_OFFLINE", "1")
    room = write_room(tmp_path / "room", count=2)
    result = CliRunner().invoke(app, ["map", str(room), "-o", str(tmp_path / "m.uppm"), "--perception", "foundation"])
    assert isinstance(result.exception, UppmError)
    said = str(result.exception)
    assert f"models {', '.join(PAPER)} on this machine, found none: offline" in said
    assert f"run `uppm models download {' '.join(PAPER)}` (8.2 GB)" in said
    assert "\n" not in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["room"]


def test_a_hub_that_fails_is_one_line_too(hub: FakeHub) -> None:
    tiny.torch_or_skip()
    hub.close()
    with pytest.raises(UppmError, match=r"^perception: expected the models .* the hub failed \(\w+") as caught:
        provide(PerceptionConfig(profile="foundation"))
    assert "\n" not in str(caught.value)


def test_what_is_wrong_anyway_is_said_before_anything_is_fetched(hub: FakeHub, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="model of sam: expected one of sam-vit-huge"):
        provide(PerceptionConfig(profile="foundation", masks_model="sam3"))
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'uppm\[foundation\]'"):
        provide(PerceptionConfig(profile="foundation"))
    assert hub.asked == []


@pytest.fixture
def papers_hub(hub: FakeHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeHub:
    """A hub with the paper's models, tiny and random, and a folder that stands for the sentence embedder's."""
    pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)
    from tests.perception.captioners import test_tag2text
    from uppm.perception.captioners import tag2text

    made = tmp_path / "made"
    made.mkdir()
    test_tag2text.write_checkpoint(made)
    seeded.write_vocabulary(made)
    tiny.made("grounding_dino", made)
    tiny.made("sam", made, "sam-vit-huge")
    for folder in made.iterdir():
        hub.files[model_spec(folder.name).repo] = {path.name: path.read_bytes() for path in folder.iterdir()}
    size = tag2text.read_architecture(made / "tag2text-swin-b", tag2text.Tag2TextSize())
    monkeypatch.setattr(tag2text, "Tag2TextSize", lambda: size)  # the published file does not state its sizes
    hub.files[model_spec(MPNET).repo] = {"model.safetensors": b"weights", "tokenizer.json": b"{}"}
    monkeypatch.setitem(MODELS, MPNET, replace(model_spec(MPNET), sha256={}))  # type: ignore[arg-type]
    monkeypatch.setattr("uppm.perception.retrieval.mpnet.MpnetEncoder", lambda: FakeTextEncoder(768))
    return hub


@pytest.mark.heavy
def test_with_a_hub_the_papers_pipeline_is_one_command(
    papers_hub: FakeHub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`uppm map SEQ --perception foundation`: all models are fetched and pinned, and the next time no hub is asked."""
    room, output = write_room(tmp_path / "room", count=3), tmp_path / "m.uppm"
    low = ["detector_score=0", "text_score=0", "min_mask_pixels=1", "threads=1"]  # for what random weights find
    settings = [*(f"perception.{value}" for value in low), "fusion.confirm_evidence=0", "fusion.min_area=0"]
    arguments = ["map", str(room), "-o", str(output), "--perception", "foundation", "--overwrite", "--no-check"]
    arguments += [part for value in settings for part in ("--set", value)]
    for offline in ("0", "1"):
        monkeypatch.setenv("UPPM_OFFLINE", offline)
        papers_hub.asked.clear()
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 0, result.exception
        fetched = {name for name in PAPER if any(model_spec(name).repo in line for line in papers_hub.asked)}
        assert fetched == (set() if offline == "1" else set(PAPER))
    assert [submap for submap in open_map(output).submaps if submap.descriptor]
