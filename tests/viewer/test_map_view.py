"""`uppm map --view` as a user runs it."""

from __future__ import annotations

import http.client
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.cli.room import write_room
from tests.viewer.command import interrupt, running
from uppm.pipeline import open_map


@pytest.mark.heavy
def test_a_map_is_served_while_it_is_made_and_after(tmp_path: Path) -> None:
    room, output = write_room(tmp_path / "room"), tmp_path / "room.uppm"
    options = ["--perception", "groundtruth", "--no-check", "--view", "--view-port", "0"]
    with running("map", room, "-o", output, *options) as process:
        assert process.stderr is not None
        address = urlsplit(process.stderr.readline().strip())
        connection = http.client.HTTPConnection("127.0.0.1", address.port or 0, timeout=60)
        connection.request("GET", "/")
        assert connection.getresponse().status == 200
        connection.close()
        assert "shows the finished map" in process.stderr.readline()
        assert interrupt(process, 120) == 0
    assert len(open_map(output).objects) == 2
