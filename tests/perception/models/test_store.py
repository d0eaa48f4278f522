"""Fetching, pinning, resuming, verifying and finding models; the real client against a hub on loopback."""

from __future__ import annotations

import hashlib
import json
import os
import re
import socket
import time
from pathlib import Path

import huggingface_hub.constants
import pytest

from tests.perception.models.conftest import NAME, REPO, WEIGHTS
from tests.perception.models.hub import FakeHub
from uppm.core.errors import ConfigError, InputError, UppmError
from uppm.perception.models import store
from uppm.perception.models.files import LOCK, read_lock
from uppm.perception.models.table import MODELS, model_spec, with_needs


def write_model(root: Path, weights: bytes = WEIGHTS) -> Path:
    folder = root / NAME
    folder.mkdir(parents=True)
    (folder / "model.safetensors").write_bytes(weights)
    (folder / "config.json").write_text("{}")
    return folder


@pytest.fixture
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any socket is a failure."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a socket was opened")

    for name in ("socket", "create_connection", "getaddrinfo"):
        monkeypatch.setattr(socket, name, refuse)


@pytest.mark.parametrize("variable", ["UPPM_OFFLINE", "HF_HUB_OFFLINE"])
def test_offline_opens_no_socket(
    machine: Path, monkeypatch: pytest.MonkeyPatch, no_network: None, variable: str
) -> None:
    monkeypatch.setenv(variable, "1")
    with pytest.raises(UppmError, match=f"offline, so the hub was not asked; run `uppm models download {NAME}`"):
        store.model_folder(NAME)
    with pytest.raises(UppmError, match="offline"):
        store.fetch(NAME)


def test_finding_never_opens_a_socket(machine: Path, no_network: None) -> None:
    tried: list[str] = []
    assert store.find(NAME, tried.append) is None
    assert tried == ["UPPM_MODELS is not set", "not in the hub's cache"]


def test_a_fetched_model_is_pinned_and_then_found_without_the_hub(
    hub: FakeHub, machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = store.model_folder(NAME)
    assert sorted(path.name for path in folder.iterdir()) == ["config.json", "model.safetensors"]
    lock = read_lock(folder.parents[1])
    assert lock is not None
    assert (lock.repo, lock.revision) == (REPO, hub.commit)
    assert lock.sha256["model.safetensors"] == hashlib.sha256(WEIGHTS).hexdigest()
    monkeypatch.setenv("UPPM_OFFLINE", "1")
    hub.asked.clear()
    assert store.model_folder(NAME) == folder
    assert hub.asked == []


def test_a_pinned_model_stays_at_its_commit(hub: FakeHub, machine: Path) -> None:
    store.model_folder(NAME)
    first, hub.commit = hub.commit, "b" * 40
    hub.asked.clear()
    store.fetch(NAME)
    assert any(f"/revision/{first}" in line for line in hub.asked)


def test_models_go_to_the_models_folder_where_one_is_set(
    hub: FakeHub, machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UPPM_MODELS", str(machine / "models"))
    assert store.model_folder(NAME) == machine / "models" / NAME
    assert (machine / "models" / NAME / LOCK).is_file()
    assert not (machine / "hub").exists()
    assert store.find(NAME) == machine / "models" / NAME


def test_a_broken_download_goes_on_where_it_ended(hub: FakeHub, machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UPPM_MODELS", str(machine / "models"))
    monkeypatch.setattr(huggingface_hub.constants, "DOWNLOAD_CHUNK_SIZE", 1 << 12)
    monkeypatch.setattr(time, "sleep", lambda _: None)  # the client waits a second before it goes on
    hub.break_after = 50_000
    folder = store.model_folder(NAME)
    assert (folder / "model.safetensors").read_bytes() == WEIGHTS
    resumed = [int(n) for line in hub.asked for n in re.findall(r"bytes=([1-9]\d*)-", line)]
    assert resumed, hub.asked
    assert max(resumed) <= 50_000


def test_what_came_is_held_to_the_sum_that_the_hub_states(hub: FakeHub, machine: Path) -> None:
    hub.lie["model.safetensors"] = "0" * 64
    with pytest.raises(InputError, match=r"model\.safetensors: expected sha256 0000"):
        store.fetch(NAME)
    assert not any(machine.rglob(LOCK))


def test_a_hub_that_fails_is_one_line(hub: FakeHub, machine: Path) -> None:
    del hub.files[REPO]["model.safetensors"], hub.files[REPO]["pytorch_model.bin"]
    with pytest.raises(InputError, match=r"expected one of model\.safetensors, .*, found config\.json"):
        store.fetch(NAME)
    hub.close()
    with pytest.raises(UppmError, match="try again") as caught:
        store.fetch(NAME)
    assert "\n" not in str(caught.value)


def test_files_put_there_by_hand_are_pinned_at_their_first_use(
    machine: Path, monkeypatch: pytest.MonkeyPatch, no_network: None
) -> None:
    folder = write_model(machine / "models")
    monkeypatch.setenv("UPPM_MODELS", str(machine / "models"))
    assert store.model_folder(NAME) == folder
    lock = json.loads((folder / LOCK).read_text())
    assert lock["revision"] is None
    assert lock["sha256"]["model.safetensors"] == hashlib.sha256(WEIGHTS).hexdigest()
    (folder / "config.json").write_text('{"other": 1}')
    with pytest.raises(InputError) as caught:
        store.model_folder(NAME)
    assert caught.value.source == str(folder / "config.json")


def test_a_corrupt_file_is_named_even_if_its_size_and_time_are_the_same(
    machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_model(machine / "models")
    monkeypatch.setenv("UPPM_MODELS", str(machine / "models"))
    store.model_folder(NAME)
    file = folder / "model.safetensors"
    stamp = file.stat().st_mtime_ns
    file.write_bytes(WEIGHTS[:-1] + b"!")
    os.utime(file, ns=(stamp, stamp))
    store.find(NAME)  # not read again, so that a frame does not wait for it
    with pytest.raises(InputError) as caught:
        store.find(NAME, again=True)
    assert caught.value.source == str(file)


def test_a_file_that_is_gone_is_named(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_model(machine / "models")
    monkeypatch.setenv("UPPM_MODELS", str(machine / "models"))
    store.model_folder(NAME)
    (folder / "config.json").unlink()
    with pytest.raises(InputError, match=r"config\.json: expected a readable file, found No such file"):
        store.model_folder(NAME)


def test_a_lock_that_is_none_is_an_error(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_model(machine / "models")
    (folder / LOCK).write_text("[]")
    monkeypatch.setenv("UPPM_MODELS", str(machine / "models"))
    with pytest.raises(InputError, match="a lock with repo"):
        store.model_folder(NAME)


def test_the_table_is_whole() -> None:
    for name, spec in MODELS.items():
        assert spec.name == name
        assert spec.licence
        assert spec.megabytes > 0
        assert spec.smaller is None or MODELS[spec.smaller].megabytes < spec.megabytes
        assert set(spec.needs) <= MODELS.keys()
        assert spec.repo.count("/") == 1
    assert with_needs(["tag2text-swin-b", "bert-base-uncased"]) == ["tag2text-swin-b", "bert-base-uncased"]
    with pytest.raises(ConfigError, match=r"expected one of all-mpnet-base-v2, .* found 'sam-vit-hug'"):
        model_spec("sam-vit-hug")
