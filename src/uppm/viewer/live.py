"""A map in the browser while it is made, at a bounded cost to the thread that makes it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from queue import Full, Queue
from threading import Lock, Thread
from time import monotonic, perf_counter, thread_time

import numpy as np
import numpy.typing as npt

from uppm.core.shown import Content
from uppm.core.types import Frame

SHARE = 0.03
"""Of the time since mapping began that the viewer may take, in the thread that maps and in its own together."""
LEAST = 0.05
"""Seconds of meshing that are worth a new map in the browser."""


class Allowance:
    """A share of the time that passes, to be spent in pieces."""

    def __init__(self, share: float, clock: Callable[[], float] = monotonic) -> None:
        self._share, self._clock = share, clock
        self._start, self._spent, self._lock = clock(), 0.0, Lock()

    def spend(self, seconds: float) -> None:
        """Note what was used."""
        with self._lock:
            self._spent += seconds

    @property
    def left(self) -> float:
        """Seconds that may be spent now; negative where too much was."""
        with self._lock:
            return self._share * (self._clock() - self._start) - self._spent


class LiveViewer:
    """A `FrameViewer` that shows the growing map in a thread of its own.

    The thread that maps meshes what changed, only while somebody watches, the map before was taken, and something of
    the allowance is left, of which half is for meshing; then it leaves the map in a mailbox for one. It never waits:
    what is slow, a browser or the way to it, sees fewer of the maps between.

    Parameters
    ----------
    show : takes a map to the browsers; called in the viewer's thread.
    watched : whether there is a browser.
    """

    def __init__(
        self, show: Callable[[Content], None], watched: Callable[[], bool], allowance: Allowance | None = None
    ) -> None:
        self._show, self._watched = show, watched
        self._allowance = allowance or Allowance(SHARE)
        self._mailbox: Queue[Content | None] = Queue(maxsize=1)
        self._thread = Thread(target=self._work, name="viewer", daemon=True)
        self._thread.start()

    def show(self, frame: Frame, submap_ids: npt.NDArray[np.int32], content: Callable[[float], Content], /) -> None:
        """Leave the map for the browsers, if they are ready for it."""
        seconds = self._allowance.left / 2
        if seconds < LEAST or self._mailbox.full() or not self._watched():
            return
        start = perf_counter()
        self._mailbox.put_nowait(content(seconds))
        self._allowance.spend(perf_counter() - start)

    def close(self) -> None:
        """End the thread, after what it is showing."""
        while self._thread.is_alive():
            with suppress(Full):
                self._mailbox.put(None, timeout=0.2)
                self._thread.join()

    def _work(self) -> None:
        while (content := self._mailbox.get()) is not None:
            start = thread_time()
            self._show(content)
            self._allowance.spend(thread_time() - start)
