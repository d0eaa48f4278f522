"""Presets, files and single settings: which wins, and what is refused."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import pytest

from uppm.core.config import PRESETS, Config
from uppm.core.errors import ConfigError


def test_presets_are_the_files_that_ship() -> None:
    folder = resources.files("uppm.data") / "presets"
    assert sorted(file.name for file in folder.iterdir()) == sorted(f"{name}.yaml" for name in PRESETS)


def test_uppm_is_the_defaults() -> None:
    assert Config.load("uppm") == Config()


def test_paper_and_panmap_say_their_rules() -> None:
    paper, panmap = Config.load("paper"), Config.load("panmap")
    assert (paper.retrieval.method, panmap.retrieval.method) == ("paper", "uppm")
    for settings in (paper.fusion, panmap.fusion):
        assert (settings.association, settings.category_policy, settings.min_iou) == ("greedy", "same", 0.1)
        assert (settings.distance, settings.life_cycle, settings.min_pixels) == ("ray", "count", 2000)
    assert (paper.fusion.votes, panmap.fusion.votes) == ("count", "first")
    assert (paper.fusion.resample, panmap.fusion.resample) == (True, False)


def test_single_settings_win_over_a_preset() -> None:
    config = Config.load("panmap", ["fusion.distance=normal", "input.stride=2"])
    assert (config.fusion.distance, config.fusion.association, config.input.stride) == ("normal", "greedy", 2)


def test_a_file_builds_on_a_preset(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("base: paper\nfusion:\n  min_pixels: 100\n")
    config = Config.load(file)
    assert (config.fusion.min_pixels, config.fusion.votes, config.retrieval.method) == (100, "count", "paper")


def test_a_file_of_a_presets_name_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("paper").write_text("fusion:\n  depth_max: 4\n")
    assert Config.load("./paper") == Config.load(Path("paper")) == Config.load(None, ["fusion.depth_max=4"])
    assert Config.load("paper").fusion.depth_max == 5


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("base: panmaps\n", "mine.yaml: expected one of uppm, paper, panmap as `base`, found 'panmaps'"),
        ("base: [paper]\n", "found \\['paper'\\]"),
        ("base: paper\nfusion: 3\n", "mine.yaml: expected a valid 'fusion'"),
    ],
)
def test_what_a_file_cannot_build_on(tmp_path: Path, content: str, message: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(content)
    with pytest.raises(ConfigError, match=message):
        Config.load(file)


def test_no_such_preset_names_those_that_are() -> None:
    with pytest.raises(ConfigError, match=r"panmaps: expected a YAML file.*or name one of uppm, paper, panmap"):
        Config.load("panmaps")
