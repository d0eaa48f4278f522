"""`uppm models`: what is here, what is not, and what is no longer what it was."""

from __future__ import annotations

import json
from pathlib import Path

import huggingface_hub.constants
import pytest
from typer.testing import CliRunner

from uppm.cli.main import app
from uppm.core.errors import ConfigError, InputError, UppmError
from uppm.perception.models.table import MODELS

NAME = "sam-vit-base"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the only model on this machine."""
    folder = tmp_path / "models" / NAME
    folder.mkdir(parents=True)
    (folder / "model.safetensors").write_bytes(b"weights")
    (folder / "config.json").write_text("{}")
    monkeypatch.setenv("UPPM_MODELS", str(tmp_path / "models"))
    monkeypatch.setenv("UPPM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("UPPM_OFFLINE", "1")
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    return folder


def run(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["models", *arguments])
    if isinstance(result.exception, UppmError):
        raise result.exception
    assert result.exit_code == code, result.output
    return result.output


def test_list_says_what_is_here(folder: Path) -> None:
    rows = {row["name"]: row for row in json.loads(run("list", "--json"))}
    assert rows.keys() == MODELS.keys()
    assert (rows[NAME]["state"], rows[NAME]["folder"]) == ("yes", str(folder))
    assert (rows["sam-vit-huge"]["state"], rows["sam-vit-huge"]["folder"]) == ("no", None)
    table = run("list")
    assert all(name in table for name in MODELS)


def test_path_is_the_folder_and_nothing_else(folder: Path) -> None:
    assert run("path", NAME) == f"{folder}\n"
    with pytest.raises(UppmError, match=r"sam-vit-huge holds no model\.safetensors or pytorch_model.bin"):
        run("path", "sam-vit-huge")


def test_verify_names_the_corrupt_file(folder: Path) -> None:
    assert run("verify") == f"{NAME}: ok, {folder}\n"
    (folder / "model.safetensors").write_bytes(b"w8ights")
    assert f"{folder / 'model.safetensors'}: expected sha256" in run("verify", code=1)
    (row,) = json.loads(run("verify", NAME, "--json", code=1))
    assert (row["name"], row["ok"], row["folder"]) == (NAME, False, str(folder))
    assert "corrupt" in {row["name"]: row["state"] for row in json.loads(run("list", "--json"))}[NAME]


def test_download_finds_what_is_here_and_stays_offline(folder: Path) -> None:
    assert run("download", NAME) == f"{NAME}: {folder}\n"
    with pytest.raises(UppmError, match=r"tag2text-swin-b: .* offline"):
        run("download", "--profile", "foundation", "--offline")


def test_names_that_are_none(folder: Path) -> None:
    with pytest.raises(InputError, match="expected a model or --profile"):
        run("download")
    for command in ("download", "verify", "path"):
        with pytest.raises(ConfigError, match="found 'sam'"):
            run(command, "sam")
