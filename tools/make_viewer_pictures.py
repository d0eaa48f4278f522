"""Make docs/images/viewer.jpg and docs/images/query.jpg: the served page in headless Chromium, on a map of flat/run1.

uppm map ../shared/data/flat/run1 --perception groundtruth -o run1.uppm
python tools/make_viewer_pictures.py run1.uppm ../shared/data/flat/run1 /usr/bin/chromium
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from playwright.sync_api import sync_playwright

from uppm.cli.view import open_source, pictures_of
from uppm.map.shown import content_of
from uppm.pipeline import open_map
from uppm.viewer.served import ServedMap

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"]
QUESTION = "the red armchair"
REST_MS = 6000
"""Until a software renderer has drawn everything."""


def shot(page: Any, width: int) -> npt.NDArray[np.uint8]:
    """The page's left part as BGR, at rest."""
    page.wait_for_timeout(REST_MS)
    image = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return np.asarray(image[:, :width], dtype=np.uint8)


def ask(page: Any, text: str) -> None:
    prompt = page.locator("input:visible").first
    prompt.fill(text)
    prompt.press("Enter")


def main() -> None:
    path, sequence, chromium = map(Path, sys.argv[1:])
    panoptic = open_map(path)
    content, served = content_of(panoptic, "run1"), ServedMap(port=0)
    served.pictures = pictures_of(content, open_source(panoptic, path, sequence))
    served.show(content)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        page = browser.new_page(viewport={"width": 1200, "height": 720})
        page.set_default_timeout(300_000)
        page.goto(served.url)
        page.wait_for_selector("text=Screenshot")
        page.wait_for_timeout(REST_MS)
        page.locator(".mantine-Notification-closeButton").click()
        steps = [shot(page, 880)]
        served.ask(QUESTION)
        steps.append(shot(page, 880))
        ask(page, QUESTION)
        steps.append(shot(page, 880))
        ask(page, "armchair")
        whole = shot(page, 1200)
        browser.close()
    served.close()
    row = [cv2.resize(step[20:700, 80:800], (480, 453), interpolation=cv2.INTER_AREA) for step in steps]
    quality = [cv2.IMWRITE_JPEG_QUALITY, 85]
    cv2.imwrite(str(IMAGES / "query.jpg"), np.hstack(row), quality)
    cv2.imwrite(str(IMAGES / "viewer.jpg"), whole, quality)


if __name__ == "__main__":
    main()
