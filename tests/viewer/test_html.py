"""The exported page in headless Chromium, without a network: prompts, answers, colours, toggles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.conftest import Uppm, uppm  # noqa: F401
from tests.viewer.conftest import HOSTILE, keep, until
from uppm.map.panoptic_map import PanopticMap
from uppm.map.shown import content_of
from uppm.viewer.html import map_page


@pytest.fixture(scope="module")
def file(panoptic: PanopticMap, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("html") / "room.html"
    path.write_text(map_page(content_of(panoptic, "room")), encoding="utf-8")
    return path


@pytest.fixture
def opened(page: Any, file: Path) -> Any:
    """The page without a network; what it asks for besides itself is an error."""
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.context.set_offline(True)
    page.goto(file.as_uri())
    until(page, "window.uppm !== undefined")
    yield page
    assert [url for url in asked if not url.startswith("blob:")] == [file.as_uri()]


def ask(page: Any, text: str) -> list[int]:
    page.fill("#prompt", text)
    page.press("#prompt", "Enter")
    until(page, "window.uppm.camera.flight === null")
    return page.evaluate("window.uppm.ask === undefined ? [] : [...window.uppm.state.answers]")


def colorful(image: np.ndarray) -> np.ndarray:
    """Where a screenshot's map is of the colour of answers."""
    red, green, blue = np.moveaxis(image[:, :690].astype(int), -1, 0)
    return (red > 150) & (red > green + 60) & (red > blue + 60)


def test_a_prompt_highlights_what_it_means(opened: Any) -> None:
    assert ask(opened, "mugs") == [2]
    at = np.argwhere(colorful(keep(opened, "html-mug")))
    # It was flown to, and stands alone in colour in the middle of the picture.
    assert len(at) > 5000
    assert np.abs(at.mean(axis=0) - (320, 350)).max() < 40
    assert np.ptp(at, axis=0).max() < 250
    assert opened.inner_text("#facts h2") == "mug #2"
    assert opened.inner_text("#answer") == "1 match"
    opened.mouse.click(350, 320)
    assert opened.evaluate("window.uppm.state.selected") == 2


def test_search_ranks_labels_over_categories(opened: Any) -> None:
    assert ask(opened, "cup") == [1, 2]
    assert opened.locator("#answers li").all_inner_texts() == ["cup #1", "mug #2"]
    assert ask(opened, "dining") == [3]
    assert ask(opened, "zebra") == []
    assert "zebra" in opened.inner_text("#answer")
    assert opened.is_hidden("#facts")
    assert ask(opened, "") == []
    assert opened.inner_text("#answer") == ""


def test_facts_are_text_not_markup(opened: Any) -> None:
    ask(opened, "mug")
    bars = opened.locator("#facts .bar").all_inner_texts()
    assert bars == ["mug · 8", f"{HOSTILE} · 2"]
    assert "cup (80 %)" in opened.inner_text("#facts")
    assert "6 to 9, seen in 5" in opened.inner_text("#facts")
    assert "No pictures" in opened.inner_text("#facts")


def test_colorings_toggles_and_time(opened: Any) -> None:
    opened.evaluate("window.uppm.camera.flyTo(window.uppm.scene.objects[1], () => {})")
    until(opened, "window.uppm.camera.flight === null")
    for name in ("instance", "category", "confidence", "change"):
        opened.select_option("#coloring", name)
        wanted = np.array(opened.evaluate(f"window.uppm.scene.objects[1].colors.{name}"), dtype=float)
        seen = keep(opened, f"html-{name}")[310:330, 340:360].reshape(-1, 3).mean(axis=0)
        assert seen @ wanted / np.linalg.norm(seen) / np.linalg.norm(wanted) > 0.999, name
    assert "absent: cup" in opened.inner_text("#legend")
    pick = "(window.uppm.view.pick(window.uppm.camera, window.uppm.state, 350, 320) || {}).id"
    assert opened.evaluate(pick) == 2
    opened.uncheck("#categories label:has-text('cup') input")
    assert opened.evaluate(pick) == 4
    opened.click("#all")
    assert opened.evaluate(pick) == 2
    opened.fill("#time", "5")
    assert opened.evaluate(pick) == 4
    opened.fill("#time", "9")
    opened.click("#whole")
    until(opened, "window.uppm.camera.flight === null")
    for name in ("#path", "#free"):
        before = keep(opened, "html-extras")
        opened.check(name)
        assert (keep(opened, "html-extras") != before)[:, :690].any(axis=-1).sum() > 30


def test_screenshot_is_a_picture_file(opened: Any) -> None:
    with opened.expect_download() as download:
        opened.click("#screenshot")
    assert download.value.suggested_filename == "room.png"
    assert Path(download.value.path()).read_bytes()[:4] == b"\x89PNG"


def test_command_writes_the_page(uppm: Uppm, map_file: Path, tmp_path: Path) -> None:  # noqa: F811
    done = uppm("view", map_file, "--export", tmp_path / "a.html")
    assert (done.code, done.out.strip()) == (0, str(tmp_path / "a.html"))
    assert (tmp_path / "a.html").stat().st_size > 10_000
    wrong = uppm("view", map_file, "--export", tmp_path / "a.txt")
    assert wrong.code == 2
    assert "a name ending in .html" in wrong.err
