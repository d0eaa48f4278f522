"""A hub on this machine's loopback: enough of the real one's interface for the real client to fetch from."""

from __future__ import annotations

import hashlib
import json
import re
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

BIG = 1 << 16
"""Files so large are told with their sha256, as the real hub does for large files."""


class FakeHub:
    """Serves the files of repositories: `hub.files["owner/name"]["file"] = bytes`, at one commit each."""

    def __init__(self) -> None:
        self.files: dict[str, dict[str, bytes]] = {}
        self.commit = "a" * 40
        self.lie: dict[str, str] = {}
        """File -> sha256 stated in place of the true one."""
        self.break_after: int | None = None
        """Bytes after which the next large answer ends before its time."""
        self.asked: list[str] = []
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        self._thread = Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def listing(self, repo: str) -> list[dict[str, object]]:
        """What the hub tells of a repository's files."""
        return [self._entry(name, content) for name, content in self.files[repo].items()]

    def _entry(self, name: str, content: bytes) -> dict[str, object]:
        sha256 = self.lie.get(name, hashlib.sha256(content).hexdigest())
        lfs = {"sha256": sha256, "size": len(content), "pointerSize": 134} if len(content) >= BIG else None
        base = {"rfilename": name, "path": name, "type": "file", "size": len(content)}
        blob = hashlib.sha1(content, usedforsecurity=False).hexdigest()
        return {**base, "blobId": blob, "oid": blob, **({"lfs": {**lfs, "oid": sha256}} if lfs else {})}

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        hub = self

        class Handler(BaseHTTPRequestHandler):
            def do_HEAD(self) -> None:
                self.do_GET(body=False)

            def do_GET(self, body: bool = True) -> None:
                hub.asked.append(f"{self.command} {self.path} {self.headers.get('Range', '')}".strip())
                path = self.path.partition("?")[0]
                if found := re.fullmatch(r"/api/(?:model|space)s/([^/]+/[^/]+)(?:/revision/[^/]+)?", path):
                    info = {"id": found[1], "sha": hub.commit, "siblings": hub.listing(found[1]), "tags": []}
                    self._answer(json.dumps({**info, "private": False, "downloads": 0, "likes": 0}).encode(), body)
                elif found := re.fullmatch(r"/api/(?:model|space)s/([^/]+/[^/]+)/tree/[^/]+", path):
                    self._answer(json.dumps(hub.listing(found[1])).encode(), body)
                elif found := re.fullmatch(r"(?:/spaces)?/([^/]+/[^/]+)/resolve/[^/]+/(.+)", path):
                    content = hub.files[found[1]][found[2]]
                    self._answer(content, body, etag=hashlib.sha256(content).hexdigest())
                else:
                    self.send_error(404)

            def _answer(self, content: bytes, body: bool, etag: str = "") -> None:
                start = int((re.findall(r"bytes=(\d+)-", self.headers.get("Range", "")) or [0])[0])
                part = content[start:]
                self.send_response(206 if start else 200)
                self.send_header("Content-Length", str(len(part)))
                if start:
                    self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
                if etag:
                    self.send_header("ETag", f'"{etag}"')
                    self.send_header("X-Repo-Commit", hub.commit)
                self.end_headers()
                if body and hub.break_after is not None and len(part) >= BIG:
                    part, hub.break_after = part[: hub.break_after], None
                    self.close_connection = True
                if body:
                    self.wfile.write(part)

            def log_message(self, format: str, *args: object) -> None:
                """Say nothing."""

        return Handler
