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


class Allowance:
    """A share of the time that passes, to be spent in pieces.

    A piece is begun only if one like the last would leave the whole within the share.
    """

    def __init__(self, share: float, clock: Callable[[], float] = monotonic) -> None:
        self._share, self._clock = share, clock
        self._start, self._lock = clock(), Lock()
        self._spent = self._piece = 0.0

    def spend(self, seconds: float, *, begins: bool = False) -> None:
        """Note what was used, for a new piece or in addition for the last."""
        with self._lock:
            self._spent += seconds
            self._piece = seconds if begins else self._piece + seconds

    @property
    def left(self) -> bool:
        """Something may be spent now."""
        with self._lock:
            return self._spent + self._piece <= self._share * (self._clock() - self._start)


class LiveViewer:
    """A `FrameViewer` that shows the growing map in a thread of its own.

    The thread that maps meshes what changed, only while somebody watches, the map before was taken, and the allowance
    is not used up; then it leaves the map in a mailbox for one. It never waits: what is slow, a browser or the way to
    it, sees fewer of the maps between.

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

    def show(self, frame: Frame, submap_ids: npt.NDArray[np.int32], content: Callable[[], Content], /) -> None:
        """Leave the map for the browsers, if they are ready for it."""
        if self._mailbox.full() or not self._allowance.left or not self._watched():
            return
        start = perf_counter()
        self._mailbox.put_nowait(content())
        self._allowance.spend(perf_counter() - start, begins=True)

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
