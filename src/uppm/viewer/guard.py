"""Who may open the served page: on loopback its own pages alone, elsewhere those who hold its token."""

from __future__ import annotations

import hmac
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
from typing import Any
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

COOKIE = "uppm_viewer"


@dataclass(frozen=True, kw_only=True)
class Guard:
    """Judges each request before viser sees it, the handshakes of web sockets among them.

    A page of another site may open a web socket to a loopback address too: so the origin of a request must be the
    address that it asks, and without a token that address must be a loopback one, which no name server can fake.
    """

    host: str
    token: str | None

    def answer(self, request: Request) -> Response | None:
        """What to answer instead of the page; None: let it pass."""
        asked = request.headers.get("Host", "")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != asked:
            return _refusal("Another site asked for this page.")
        if self.token is None:
            own = is_loopback(urlsplit(f"//{asked}").hostname or "")
            return None if own else _refusal("This viewer is for this machine alone.")
        given = parse_qs(urlsplit(request.path).query).get("token", [""])[0]
        if self._is_token(given):
            cookie = f"{COOKIE}={self.token}; HttpOnly; SameSite=Lax; Path=/"
            return _response(HTTPStatus.SEE_OTHER, "", {"Location": "/", "Set-Cookie": cookie})
        if self._is_token(_cookie(request.headers.get("Cookie", ""))):
            return None
        return _refusal("This viewer needs its token: open the address that uppm printed.")

    def _is_token(self, given: str) -> bool:
        return self.token is not None and hmac.compare_digest(given.encode(), self.token.encode())


def is_loopback(host: str) -> bool:
    """The name or address of this machine for itself."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


@contextmanager
def guarded(guard: Guard) -> Generator[None]:
    """Servers of web sockets that start meanwhile ask the guard first.

    viser has no hook for it; `websockets` has one, which viser uses. Raises `RuntimeError` where none was started so.
    """
    usual, started = websockets.asyncio.server.serve, []

    def serve(*args: Any, process_request: Any, **options: Any) -> Any:
        def judge(connection: Any, request: Request) -> Any:
            return guard.answer(request) or process_request(connection, request)

        started.append(args)
        return usual(*args, process_request=judge, **options)

    websockets.asyncio.server.serve = serve  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = usual
    if not started:
        raise RuntimeError("viser started its server in another way than this version knows to guard")


def _cookie(header: str) -> str:
    try:
        morsel = SimpleCookie(header).get(COOKIE)
    except CookieError:
        return ""
    return morsel.value if morsel else ""


def _refusal(why: str) -> Response:
    return _response(HTTPStatus.FORBIDDEN, why, {})


def _response(status: HTTPStatus, text: str, headers: dict[str, str]) -> Response:
    body = text.encode()
    own = {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body)), "Connection": "close"}
    return Response(int(status), status.phrase, Headers({**own, **headers}), body)
