"""A map as a page in the browser, served by viser."""

from __future__ import annotations

import io
import socket
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from secrets import token_urlsafe
from threading import RLock
from typing import Any

from uppm.core.errors import InputError, MissingExtraError
from uppm.core.shown import Answers, Content, Shown
from uppm.viewer.flight import fly, near_view, start_view
from uppm.viewer.look import Look

PORT = 8080
LOOPBACK = "127.0.0.1"
TOKEN_BYTES = 24

Pictures = Callable[[Shown], list[bytes]]
"""JPEG files of an object's best views."""


class ServedMap:
    """Shows a map in any number of browsers, which share what is chosen and asked.

    Parameters
    ----------
    host : str
        Address to bind to. One that is not a loopback address is open to others, so a random token is asked for.
    port : int
        The next free one is taken where it is in use.

    Raises
    ------
    InputError
        The address is none of this machine's.
    MissingExtraError
        viser is not installed.
    """

    def __init__(self, *, host: str = LOOPBACK, port: int = PORT) -> None:
        server, self._token = start_server(host, port)
        from uppm.viewer.nodes import MapNodes
        from uppm.viewer.panel import Panel

        self._server, self._host = server, host
        self.pictures: Pictures = lambda shown: []
        """Gives the best views of an object; asked when it is clicked."""
        self._lock = RLock()
        self.look = Look()
        """What is chosen now."""
        self._content: Content | None = None
        server.scene.world_axes.visible = False
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        self.nodes = MapNodes(server.scene, self._clicked)
        self.panel = Panel(server.gui, changed=self.choose, ask=self.ask, whole=self._fly_home)

    @property
    def url(self) -> str:
        """Where to open it, the token included."""
        host = socket.gethostname() if self._host in ("0.0.0.0", "::") else self._host
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{self._server.get_port()}/" + (f"?token={self._token}" if self._token else "")

    @property
    def watched(self) -> bool:
        """Some browser is open."""
        return bool(self._server.get_clients())

    def show(self, content: Content) -> None:
        """Show a map, or a newer state of it: only what differs is sent."""
        with self._lock, self._server.atomic():
            first = self._content is None or not self._content.shown
            self._content = content
            if first and content.shown:
                self._look_at_all(content)
            self.nodes.update(content, self.look)
            last = max([0, *(index for index, _ in content.path), *(s.submap.last_frame for s in content.shown)])
            self.panel.update(content.shown, last, content.gone)

    def choose(self, **fields: Any) -> None:
        """Change what is shown; fields of `Look`."""
        with self._lock, self._server.atomic():
            self.look = replace(self.look, **fields)
            self.nodes.restyle(self.look)

    def ask(self, text: str, client: Any = None) -> Answers:
        """Highlight what answers a prompt, dim the rest, fly a browser to the best; an empty prompt shows all again."""
        content = self._content
        answers = Answers(ids=(), said=())
        if text.strip() and content is not None:
            answers = content.ask(text)
        there = self.nodes.shown
        ids = tuple(id_ for id_ in answers.ids if id_ in there)
        self.choose(answers=ids, selected=None)
        self._tell(ids[0] if ids else None)
        if ids and client is not None:
            self._fly_to(there[ids[0]], client)
        return answers

    def close(self) -> None:
        """Stop serving."""
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def _clicked(self, submap_id: int, event: Any) -> None:
        again = self.look.selected == submap_id
        self.choose(selected=None if again else submap_id)
        self._tell(None if again else submap_id)

    def _tell(self, submap_id: int | None) -> None:
        shown = self.nodes.shown.get(submap_id) if submap_id is not None else None
        self.panel.tell(shown, self.pictures(shown) if shown else ())

    def _look_at_all(self, content: Content) -> None:
        eye, target = start_view(content.shown, content.up)
        self._server.scene.set_up_direction(tuple(content.up))
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.up = eye, target, content.up

    def _fly_home(self, client: Any) -> None:
        if self._content is not None:
            fly(client, *start_view(self._content.shown, self._content.up))

    def _fly_to(self, shown: Shown, client: Any) -> None:
        if self._content is not None:
            fly(client, *near_view(shown, client.camera.position, self._content.up))


def start_server(host: str, port: int) -> tuple[Any, str | None]:
    """viser's server behind a guard, and its token where there is one."""
    try:
        import viser
    except ImportError:
        raise MissingExtraError("viser, which serves the viewer,", "pip install uppm[view]") from None
    from uppm.viewer.guard import Guard, guarded, is_loopback

    class Server(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> str | None:
            # A browser may ask for a tunnel through viser's own servers: a map is nobody else's.
            return None

    check_address(host)
    token = None if is_loopback(host) else token_urlsafe(TOKEN_BYTES)
    # viser prints its own address, which lacks the token.
    with guarded(Guard(host=host, token=token)), redirect_stdout(io.StringIO()):
        return Server(host=host, port=port, label="uppm", verbose=False), token


def check_address(host: str) -> None:
    """Raise `InputError` where an address cannot be bound to; viser would wait for ever."""
    try:
        family, kind, *_, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except OSError as error:
        advice = "use 127.0.0.1, or 0.0.0.0 for all addresses"
        raise InputError(
            "--host", expected="an address of this machine", found=f"{host!r} ({error})", advice=advice
        ) from None
