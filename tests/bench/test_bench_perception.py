"""`uppm bench perception` on tiny architectures, and what it writes for the real ones."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.perception.captioners import seeded
from uppm.bench import random_models
from uppm.cli.main import app
from uppm.core.errors import ConfigError
from uppm.perception.models.network import COMMAND
from uppm.perception.models.store import RANDOM_MARKER

torch = pytest.importorskip("torch", reason=f"torch is not installed: {COMMAND}", exc_type=ImportError)


def tiny_tag2text(folder: Path) -> None:
    sizes = {"swin": seeded.SWIN, "text": seeded.TEXT, "tagging": seeded.TAGGING}
    (folder / "architecture.json").write_text(json.dumps(sizes))


def tiny_vocabulary(folder: Path) -> None:
    (folder / "vocab.txt").write_text("\n".join(seeded.WORDS) + "\n")


def test_stages_are_timed_beside_the_paper_s(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UPPM_MODELS", "/as/before")
    tiny = {"tag2text-swin-b": tiny_tag2text, "bert-base-uncased": tiny_vocabulary}
    monkeypatch.setattr(random_models, "ARCHITECTURES", tiny)
    chosen = ["captioner=tag2text", "detector=nanodet", "masks=box", "device=cpu", "threads=1"]
    settings = [part for name in chosen for part in ("--set", f"perception.{name}")]
    arguments = ["bench", "perception", "--random-weights", "--profile", "embedded", "--frames", "1", *settings]
    result = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
    assert list(result["stages_ms"]) == ["labels", "detector", "nms", "masks", "retrieval", "fusion"]
    assert result["sum_ms"]["wall"] == pytest.approx(sum(s["wall"] for s in result["stages_ms"].values()), abs=0.1)
    assert all(stage["wall"] >= 0 for stage in result["stages_ms"].values())
    assert result["models"] == ["tag2text-swin-b"]
    assert result["paper_ms"]["masks"] == 180
    assert "weights are random" in result["note"]
    assert os.environ["UPPM_MODELS"] == "/as/before"


def test_random_weights_must_be_asked_for_and_their_architecture_known(tmp_path: Path) -> None:
    assert CliRunner().invoke(app, ["bench", "perception"]).exit_code == 2
    with pytest.raises(
        ConfigError, match=r"--random-weights: expected one of bert-base-uncased, .*, found oneformer-swin-large"
    ):
        random_models.write_random_model("oneformer-swin-large", tmp_path)


@pytest.mark.parametrize("name", random_models.ARCHITECTURES)
def test_a_folder_of_each_architecture_is_written(tmp_path: Path, name: str) -> None:
    folder = random_models.write_random_model(name, tmp_path)
    assert json.loads((folder / RANDOM_MARKER).read_text()) == {"seed": 0}
