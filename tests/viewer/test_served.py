"""The served page in headless Chromium, and who may open it."""

from __future__ import annotations

import http.client
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from tests.cli.conftest import Uppm, uppm  # noqa: F401
from tests.viewer.command import interrupt, running
from tests.viewer.conftest import keep
from uppm.core.errors import InputError
from uppm.map.panoptic_map import PanopticMap
from uppm.map.shown import content_of
from uppm.viewer.served import ServedMap

WIDTH = 680
"""Pixels of the screenshots that the map has; the panel has the rest."""


@pytest.fixture(scope="module")
def served(panoptic: PanopticMap) -> Iterator[ServedMap]:
    server = ServedMap(port=0)
    server.show(content_of(panoptic, "room"))
    yield server
    server.close()


@pytest.fixture
def opened(served: ServedMap, page: Any) -> Any:
    page.goto(served.url)
    page.wait_for_selector("text=Screenshot")
    page.wait_for_function("document.querySelectorAll('canvas').length > 0")
    yield page
    served.ask("")
    served.choose(coloring="texture", until=None)


def settled(page: Any) -> np.ndarray:
    """A screenshot, as soon as two in turn are the same."""
    last = keep(page, "served")
    for _ in range(200):
        page.wait_for_timeout(100)
        now = keep(page, "served")
        if np.array_equal(now[:, :WIDTH], last[:, :WIDTH]):
            return now
        last = now
    raise AssertionError("the picture never came to rest")


def when(page: Any, condition: Any) -> None:
    for _ in range(1200):
        if condition():
            return
        page.wait_for_timeout(50)
    raise AssertionError("it never came to that")


def test_a_prompt_highlights_what_it_means(opened: Any, served: ServedMap) -> None:
    when(opened, lambda: served.watched)
    settled(opened)
    prompt = opened.locator("input:visible").first
    prompt.fill("mug")
    prompt.press("Enter")
    when(opened, lambda: served.look.answers)
    assert served.look.answers[0] == 2
    opened.wait_for_selector("text=mug #2")
    settled(opened)
    red, green, blue = np.moveaxis(keep(opened, "served-mug")[:, :WIDTH].astype(int), -1, 0)
    at = np.argwhere((red > 180) & (red > green + 70) & (red > blue + 70))
    # It was flown to, and stands in the middle of the picture.
    assert len(at) > 3000
    assert np.abs(np.median(at, axis=0) - (320, 340)).max() < 60
    assert opened.get_by_text("mug · 8").is_visible()
    assert opened.get_by_text("No pictures").is_visible()
    opened.mouse.click(*np.median(at, axis=0)[::-1].tolist())
    when(opened, lambda: served.look.selected == 2)
    prompt.fill("airplane")
    prompt.press("Enter")
    opened.wait_for_selector("text=nothing here matches")
    assert served.look.answers == ()


@pytest.mark.heavy
def test_panel_changes_the_picture(opened: Any, served: ServedMap) -> None:
    before = settled(opened)
    for number, field in enumerate(("path", "free")):
        opened.locator("input[type=checkbox]:visible").nth(number).check(force=True)
        when(opened, lambda field=field: getattr(served.look, field))
        after = settled(opened)
        assert (after != before)[:, :WIDTH].any(axis=-1).sum() > 100, field
        before = after
    served.choose(coloring="change")
    green = settled(opened)[:, :WIDTH].astype(int)
    assert ((green[..., 1] > green[..., 0] + 60) & (green[..., 1] > green[..., 2] + 40)).sum() > 300
    keep(opened, "served-changes")
    assert opened.get_by_text("cup #8: absent").first.is_visible()
    served.choose(
        path=False, free=False, hidden=frozenset(str(s.facts["category"]) for s in served.nodes.shown.values())
    )
    marked = settled(opened)[:, :WIDTH].astype(int)
    served.choose(hidden=frozenset())
    # Nothing but the red ball where the older map had a cup, and its name.
    red = marked[..., 0] - marked[..., 1:].max(axis=-1)
    assert (red[160:] > 80).sum() > 50
    with opened.expect_download() as download:
        opened.get_by_role("button", name="Screenshot").click()
    assert Path(download.value.path()).read_bytes()[:4] == b"\x89PNG"


def status(served: ServedMap, path: str = "/", *, socket: bool = False, **headers: str) -> tuple[int, Any]:
    """Status and headers of a request, or of a web socket's handshake, from this machine."""
    import viser

    port = urlsplit(served.url).port
    connection = http.client.HTTPConnection("127.0.0.1", port or 0, timeout=20)
    if socket:
        headers |= {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}
        headers |= {
            "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
            "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}",
        }
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    connection.close()
    return answer.status, answer.headers


def test_loopback_serves_its_own_pages_only(served: ServedMap) -> None:
    host = f"127.0.0.1:{urlsplit(served.url).port}"
    assert "token" not in served.url
    assert status(served)[0] == 200
    assert status(served, socket=True, Origin=f"http://{host}")[0] == 101
    assert status(served, socket=True, Origin="https://elsewhere.example")[0] == 403
    assert status(served, socket=True, Host="elsewhere.example")[0] == 403
    assert status(served, Host="elsewhere.example:80")[0] == 403
    assert status(served, Host="localhost")[0] == 200


def test_another_address_needs_its_token() -> None:
    open_to_all = ServedMap(host="0.0.0.0", port=0)
    try:
        token = open_to_all.url.partition("?token=")[2]
        assert len(token) >= 32
        for path in ("/", "/?token=", "/?token=wrong", f"/?token={token[:-1]}"):
            assert status(open_to_all, path)[0] == 403
        assert status(open_to_all, socket=True)[0] == 403
        assert status(open_to_all, socket=True, Cookie="uppm_viewer=wrong")[0] == 403
        code, headers = status(open_to_all, f"/?token={token}", Host="robot.example")
        assert (code, headers["Location"]) == (303, "/")
        cookie = headers["Set-Cookie"].split(";")[0]
        assert "HttpOnly" in headers["Set-Cookie"]
        assert status(open_to_all, Cookie=cookie)[0] == 200
        assert status(open_to_all, socket=True, Cookie=cookie)[0] == 101
        assert status(open_to_all, socket=True, Cookie=cookie, Origin="https://elsewhere.example")[0] == 403
    finally:
        open_to_all.close()


def test_each_token_is_another() -> None:
    urls = []
    for _ in range(2):
        server = ServedMap(host="0.0.0.0", port=0)
        urls.append(server.url.partition("token=")[2])
        server.close()
    assert urls[0] != urls[1]


def test_nobody_opens_a_tunnel(served: ServedMap) -> None:
    assert served._server.request_share_url() is None


def test_an_address_of_another_machine() -> None:
    with pytest.raises(InputError, match="an address of this machine"):
        ServedMap(host="192.0.2.1", port=0)


def test_without_viser(uppm: Uppm, map_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setitem(sys.modules, "viser", None)
    done = uppm("view", map_file)
    assert done.code == 2
    assert "pip install uppm[view]" in done.err


def test_command_serves_until_interrupted(map_file: Path) -> None:
    with running("view", map_file, "--port", "0") as process:
        assert process.stdout is not None
        port = urlsplit(process.stdout.readline().split()[0]).port
        connection = http.client.HTTPConnection("127.0.0.1", port or 0, timeout=20)
        connection.request("GET", "/")
        assert connection.getresponse().status == 200
        connection.close()
        assert interrupt(process, 60) == 0
        assert process.stdout.read() == ""
