"""The viewer of a running map: what it costs the thread that maps, and what a browser sees."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from threading import Event, get_ident
from typing import Any

import numpy as np
import pytest

from tests.scenes import Box, Plane, look_at, render
from tests.viewer.conftest import keep
from uppm.core.config import Config
from uppm.core.shown import Content
from uppm.core.types import Frame, GroundTruth
from uppm.map.answer import NO_ROOMS_YET
from uppm.map.panoptic_map import PanopticMap
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.pipeline import Mapper
from uppm.viewer.live import LEAST, Allowance, LiveViewer
from uppm.viewer.served import ServedMap

SHAPES = [Plane([0, 0, 1], 0.0), Box([-0.3, -0.2, 0.0], [0.3, 0.2, 0.4]), Box([0.9, -0.3, 0.0], [1.2, 0.1, 0.5])]
NAMES = {1: "floor", 2: "suitcase", 3: "chair"}


def frame_at(index: int, shapes: int) -> Frame:
    angle = 0.3 * index
    eye = [2.4 * np.cos(angle), 2.4 * np.sin(angle), 1.4]
    frame, ids = render(SHAPES[:shapes], look_at(eye, [0.4, 0.0, 0.2]), index)
    truth = GroundTruth(instance=ids, names=NAMES, things=frozenset({2, 3}))
    object.__setattr__(frame, "truth", truth)
    return frame


def mapper(viewer: Any = None) -> Mapper:
    return Mapper(Config.load(None, ["perception.profile=groundtruth", "fusion.max_blocks=20000"]), viewer=viewer)


def empty() -> Content:
    none = np.empty((0, 3), dtype=np.float32)
    return Content(title="", up=np.array([0.0, 0.0, 1.0]), shown=(), free=none, path=())


class Endless:
    """An allowance that is never used up."""

    left = 1000.0

    def spend(self, seconds: float) -> None: ...


def test_an_allowance_is_a_share_of_the_time() -> None:
    now = 100.0
    allowance = Allowance(0.1, lambda: now)
    assert allowance.left == 0
    allowance.spend(2.0)
    now = 115.0
    assert allowance.left == pytest.approx(-0.5)
    now = 130.0
    assert allowance.left == pytest.approx(1.0)


def test_a_slow_browser_never_slows_mapping() -> None:
    """While one map is on its way for ever, a second waits, and no third is made."""
    taken, go, made = Event(), Event(), []

    def slow(content: Content) -> None:
        taken.set()
        go.wait()

    def content(seconds: float) -> Content:
        made.append(get_ident())
        return empty()

    viewer = LiveViewer(slow, lambda: True, Endless())  # pyright: ignore[reportArgumentType]
    frame = frame_at(0, 1)
    ids = np.zeros(frame.depth.shape, dtype=np.int32)
    viewer.show(frame, ids, content)
    assert taken.wait(timeout=60)
    for _ in range(50):
        viewer.show(frame, ids, content)
    assert made == [get_ident()] * 2
    go.set()
    viewer.close()


def test_without_a_browser_nothing_is_meshed() -> None:
    made: list[Content] = []
    viewer = LiveViewer(made.append, lambda: False)
    mapping = mapper(viewer)
    mapping.integrate(frame_at(0, 2))
    viewer.close()
    assert made == []
    assert not mapping._mesher._submaps


def test_the_share_bounds_what_is_shown() -> None:
    """Half of what is left is for meshing; whoever takes twice as long waits until that is made up for."""
    now, given = 0.0, []

    def content(seconds: float) -> Content:
        given.append((now, seconds))
        allowance.spend(2 * seconds)
        return empty()

    allowance = Allowance(0.04, lambda: now)
    viewer = LiveViewer(lambda content: None, lambda: True, allowance)
    frame = frame_at(0, 1)
    for second in range(100):
        now = float(second)
        while viewer._mailbox.full():
            pass
        viewer.show(frame, np.zeros(frame.depth.shape, dtype=np.int32), content)
    viewer.close()
    assert len(given) > 15
    assert all(at >= 1 and seconds >= LEAST for at, seconds in given)
    assert sum(2 * seconds for _, seconds in given) <= 0.04 * 100


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_viewer_that_failed_can_be_closed() -> None:
    def fail(content: Content) -> None:
        sys.exit()  # ends the thread, and nothing else

    viewer = LiveViewer(fail, lambda: True, Endless())  # pyright: ignore[reportArgumentType]
    frame = frame_at(0, 1)
    for _ in range(3):
        viewer.show(frame, np.zeros(frame.depth.shape, dtype=np.int32), lambda seconds: empty())
    viewer.close()
    assert not viewer._thread.is_alive()


def test_objects_appear_while_mapping() -> None:
    maps: list[Content] = []
    viewer = LiveViewer(maps.append, lambda: True, Endless())  # pyright: ignore[reportArgumentType]
    mapping = mapper(viewer)
    for n in range(3):
        mapping.integrate(frame_at(n, 2))
    for n in range(3, 6):
        mapping.integrate(frame_at(n, 3))
    viewer.close()
    first, last = maps[0], maps[-1]
    assert {s.name for s in first.shown} == {"floor", "suitcase"}
    assert {s.name for s in last.shown} == {"floor", "suitcase", "chair"}
    assert len(last.path) > len(first.path)
    assert last.ask("chair").ids == tuple(s.submap.id for s in last.shown if s.name == "chair")


def test_the_thread_that_maps_embeds_nothing_for_a_viewer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The encoder, half a second to load, is asked by whoever asks a question."""
    embedded: list[int] = []
    encode = LabelEmbeddings.encode

    def noted(self: LabelEmbeddings, texts: Sequence[str]) -> np.ndarray:
        embedded.append(get_ident())
        return encode(self, texts)

    mapping = mapper(LiveViewer(lambda content: None, lambda: True, Endless()))  # pyright: ignore[reportArgumentType]
    mapping.integrate(frame_at(0, 3))
    monkeypatch.setattr(LabelEmbeddings, "encode", noted)
    mapping.integrate(frame_at(1, 3))
    assert embedded == []
    assert mapping.map.query("chair").found
    assert embedded


def test_questions_while_mapping_read_no_voxels(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are of the surfaces that are shown; the map that runs on has others, and changes its voxels meanwhile."""
    maps: list[Content] = []
    viewer = LiveViewer(maps.append, lambda: True, Endless())  # pyright: ignore[reportArgumentType]
    mapping = mapper(viewer)
    for n in range(6):
        mapping.integrate(frame_at(n, 3))
    viewer.close()
    monkeypatch.setattr(PanopticMap, "blocks", None)
    ids, ask = {s.name: s.submap.id for s in maps[-1].shown}, maps[-1].ask
    assert ask("how many chairs").said[:2] == ("understood as: how many: chairs", "1 in all")
    assert ask("what is on the floor").ids == (ids["suitcase"], ids["chair"])
    assert ask("the tallest thing").said[-1].startswith(f"chair #{ids['chair']}: tallest of 2: 0.5")
    assert ask("chair in front of the suitcase").ids == (ids["chair"],)
    for question in ("chair in the kitchen", "chair in the same room as the suitcase"):
        found = ask(question)
        assert (found.ids, NO_ROOMS_YET in found.said) == ((), True)


@pytest.mark.heavy
def test_a_browser_sees_the_map_grow(page: Any) -> None:
    served = ServedMap(port=0)
    viewer = LiveViewer(served.show, lambda: served.watched, Endless())  # pyright: ignore[reportArgumentType]
    try:
        page.goto(served.url)
        page.wait_for_selector("text=Screenshot")
        mapping = mapper(viewer)
        pictures = []
        for shapes, frames in ((2, range(3)), (3, range(3, 9))):
            for n in frames:
                mapping.integrate(frame_at(n, shapes))
            page.wait_for_timeout(3000)
            pictures.append(keep(page, f"live-{shapes}"))
        assert {s.name for s in served.nodes.shown.values()} == {"floor", "suitcase", "chair"}
        assert (pictures[0] != pictures[1])[:, :680].any(axis=-1).sum() > 1000
        prompt = page.locator("input:visible").first
        prompt.fill("chair")
        prompt.press("Enter")
        page.wait_for_selector("text=chair · ")
    finally:
        viewer.close()
        served.close()
