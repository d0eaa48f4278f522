"""A map of two cups, a table and a floor, a real browser, and where its pictures are kept."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.map.scenes import blocks_of, box, checkpoint_of, label_of, plane, sphere, submap_of
from tests.scenes import look_at
from uppm.core.categories import category_by_name
from uppm.core.types import Change, ChangeState, DynamicDescriptor, FrameRecord, Submap, SubmapKind, VoxelBlocks
from uppm.map.panoptic_map import PanopticMap
from uppm.map.store import MapWriter
from uppm.pipeline import open_map

PICTURES = Path(__file__).resolve().parents[2] / "out" / "viewer"
"""Screenshots stay here, to be looked at."""
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking")
HOSTILE = "</script><img src=x onerror=alert(1)>"
"""What a network might say of an object."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium with a software renderer."""
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine: the page is not opened (apt-get install chromium)")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield chromium
        chromium.close()


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """An empty page; the test fails if a script of it does."""
    opened = browser.new_page(viewport={"width": 1000, "height": 640})
    opened.set_default_timeout(120_000)  # a busy machine draws slowly
    errors: list[str] = []
    opened.on("pageerror", lambda error: errors.append(str(error)))
    yield opened
    opened.close()
    assert errors == []


@pytest.fixture(scope="session")
def map_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Cup 1 stands left, cup 2 right, table 3 between them, on floor 4; 5 is freespace. Read only."""
    file = tmp_path_factory.mktemp("viewer") / "room.uppm"
    frames = tuple(
        FrameRecord(index=n, stamp=float(n), T_map_camera=look_at([1.2 * np.cos(n), np.sin(n), 0.8], [0, 0, 0]))
        for n in range(10)
    )
    with MapWriter.create(file, "{}", {"up": "0 0 1"}) as writer:
        writer.checkpoint(checkpoint_of(submaps(), changed=voxels(), frames=frames))
        writer.record_changes([change(ChangeState.NEW, None, 1), change(ChangeState.ABSENT, 8, None)])
    return file


@pytest.fixture(scope="session")
def panoptic(map_file: Path) -> PanopticMap:
    return open_map(map_file)


def submaps() -> list[Submap]:
    categories = category_by_name()
    cups = [placed(id_, "cup", x, first) for id_, x, first in ((1, -1.0, 0), (2, 1.0, 6))]
    labels = (label_of("mug", 8, categories["cup"]), label_of(HOSTILE, 2, categories["cup"]))
    described = DynamicDescriptor(labels=labels, category=categories["cup"], confidence=0.8)
    object.__setattr__(cups[1], "descriptor", described)
    floor = placed(4, "floor-wood", 0.0, 0, kind=SubmapKind.BACKGROUND, voxel=0.05)
    object.__setattr__(floor, "bounds", np.array([[-1.6, -1.2, -0.3], [1.6, 1.2, -0.2]]))
    return [*cups, placed(3, "dining table", 0.0, 0), floor, placed(5, None, 0.0, 0, kind=SubmapKind.FREESPACE)]


def placed(id_: int, category: str | None, x: float, first: int, **options: Any) -> Submap:
    named = category_by_name()[category] if category else None
    submap = submap_of(id_, named, bounds=((x - 0.2, -0.2, -0.2), (x + 0.2, 0.2, 0.2)), **options)
    pose = np.eye(4)
    pose[0, 3] = x
    object.__setattr__(submap, "T_map_submap", pose)
    object.__setattr__(submap, "first_frame", first)
    return submap


def voxels() -> dict[int, VoxelBlocks]:
    ball = blocks_of(sphere((0, 0, 0), 0.2), (-0.3,) * 3, (0.3,) * 3, 0.02)
    return {
        1: ball,
        2: ball,
        3: blocks_of(box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.1)), (-0.4,) * 3, (0.4,) * 3, 0.02),
        4: blocks_of(plane((0, 0, 1), -0.25), (-1.6, -1, -0.5), (1.6, 1, 0.1), 0.05),
        5: blocks_of(plane((0, 0, 1), 0.0), (-0.3, -0.3, -0.1), (0.3, 0.3, 0.3), 0.02),
    }


def change(state: ChangeState, old: int | None, new: int | None) -> Change:
    center = np.zeros(3)
    return Change(
        state=state, id_old=old, id_new=new, category="cup", label="cup", evidence={},
        center_old=center if old else None, center_new=center if new else None,
    )  # fmt: skip


def until(page: Any, condition: str) -> None:
    """Wait for a JavaScript condition; evaluated from outside, since the page's own policy forbids `eval`."""
    for _ in range(2000):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(25)
    raise AssertionError(f"the page never came to {condition}")


def keep(page: Any, name: str) -> np.ndarray:
    """Screenshot (H, W, 3) as RGB, kept as a file too."""
    import cv2

    PICTURES.mkdir(parents=True, exist_ok=True)
    data = page.screenshot(path=PICTURES / f"{name}.png")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image[..., ::-1]
