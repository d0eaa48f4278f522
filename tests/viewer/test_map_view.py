"""`uppm map --view` as a user runs it."""

from __future__ import annotations

import http.client
import signal
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.cli.room import write_room
from uppm.pipeline import open_map


@pytest.mark.heavy
def test_a_map_is_served_while_it_is_made_and_after(tmp_path: Path) -> None:
    room, output = write_room(tmp_path / "room"), tmp_path / "room.uppm"
    options = ["--perception", "groundtruth", "--no-check", "--view", "--view-port", "0"]
    command = [sys.executable, "-m", "uppm.cli.main", "map", str(room), "-o", str(output), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            address = urlsplit(process.stderr.readline().strip())
            connection = http.client.HTTPConnection("127.0.0.1", address.port or 0, timeout=60)
            connection.request("GET", "/")
            assert connection.getresponse().status == 200
            connection.close()
            assert "shows the finished map" in process.stderr.readline()
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(timeout=120) == 0
    assert len(open_map(output).objects) == 2
