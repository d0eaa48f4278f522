"""The program in a process of its own, which Ctrl-C ends."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

START = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from uppm.cli.main import main; main()"
)
"""A shell's background job, which a test run may be, ignores Ctrl-C, and so do the processes that it starts."""


@contextmanager
def running(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """Start `uppm` with arguments; what still runs in the end is killed."""
    command = [sys.executable, "-c", START, *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def interrupt(process: subprocess.Popen[str], seconds: float) -> int:
    """Press Ctrl-C, and return the exit code; fails where it takes longer."""
    process.send_signal(signal.SIGINT)
    return process.wait(timeout=seconds)
