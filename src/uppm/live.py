"""Frames from any thread: a bounded queue before a mapper, and one thread that maps what waits in it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from threading import Condition
from time import monotonic
from types import TracebackType
from typing import Literal, get_args

from uppm.core.errors import BadFrameError, InputError, UppmError, nothing_usable
from uppm.core.types import Frame
from uppm.map.store import MapWriter, check_free
from uppm.pipeline import Mapper

Policy = Literal["drop-oldest", "drop-newest", "block"]
"""What a full queue does with one frame more: drop the one that waits longest, drop the new one, let its giver wait."""


@dataclass(frozen=True, kw_only=True)
class LiveStatistics:
    """What became of the frames; received = mapped + skipped + dropped + waiting + in_work."""

    received: int
    mapped: int
    """Fused into the map."""
    skipped: int
    """Looked at and not fused: blurred, say. `mapper.report.skipped` has the reasons."""
    dropped: int
    """Never looked at: the queue was full, or mapping had ended."""
    waiting: int
    """In the queue."""
    in_work: int
    """1 while a frame is mapped."""
    latency: float
    """Seconds from `push` until the frame was fused: of the last frame mapped; 0 before the first."""
    mean_latency: float
    max_latency: float


class LiveMapper:
    """Maps the frames that any thread pushes, in a thread of its own.

    What goes wrong in that thread is raised by the next call of `push`, `flush` or `close`; frames that wait then are
    dropped, and a file holds its last checkpoint. As a context manager it closes at the end; where the block ends with
    an error, it drops what waits, and writes what was mapped.

    Parameters
    ----------
    mapper : Mapper
        Its map may be asked at any time; hold `mapper.lock` to read voxels. It is closed with this.
    capacity : int
        Frames that wait at most.
    policy : "drop-oldest", "drop-newest" or "block"
    output : path, optional
        Map file to write: a transaction every `map.checkpoint_every` frames mapped, and one at the end.
    overwrite : bool
        Replace an existing map; it stays whole until the new one's first checkpoint.

    Raises
    ------
    InputError
        The capacity is below 1, or there is no such policy.
    MapFileError
        The file exists and `overwrite` is False.

    Examples
    --------
    >>> with LiveMapper(Mapper(), output="run.uppm") as live:
    ...     camera.on_frame(live.push)
    ...     camera.run()
    """

    def __init__(
        self,
        mapper: Mapper,
        *,
        capacity: int = 4,
        policy: Policy = "drop-oldest",
        output: str | Path | None = None,
        overwrite: bool = False,
    ) -> None:
        if policy not in get_args(Policy):
            expected = f"one of {', '.join(get_args(Policy))}"
            raise InputError("policy", expected=expected, found=repr(policy), advice="name one of these")
        if capacity < 1:
            raise InputError("capacity", expected="at least 1", found=str(capacity), advice="let one frame wait")
        if output is not None:
            check_free(Path(output), overwrite)
        self.mapper, self.policy, self.capacity = mapper, policy, capacity
        self._output, self._overwrite = output, overwrite
        self._changed = Condition()
        self._queue: deque[tuple[float, Frame]] = deque()
        self._received = self._mapped = self._skipped = self._dropped = self._in_work = 0
        self._latency = self._total_latency = self._max_latency = 0.0
        self._closed = False
        self._error: BaseException | None = None
        self._writer: MapWriter | None = None
        # A task a frame that waits: an idle thread then waits in the pool, which ends with the program.
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="uppm-live")

    def push(self, frame: Frame, timeout: float | None = None) -> bool:
        """Queue a frame; returns at once but for the policy "block", which waits until there is room.

        Parameters
        ----------
        timeout : float, optional
            Seconds to wait for room at most; None: as long as it takes.

        Returns
        -------
        bool
            Whether this frame waits now; False: it was dropped, and counted as such.

        Raises
        ------
        UppmError
            This mapper is closed. Any error of the mapping thread is raised, too.
        """
        with self._changed:
            if self.policy == "block":
                self._changed.wait_for(lambda: self._has_room() or self._over(), timeout)
            self._raise_error()
            if self._closed:
                raise UppmError("no frame can be pushed: this LiveMapper is closed")
            self._received += 1
            if not self._has_room():
                self._dropped += 1
                if self.policy != "drop-oldest":
                    return False
                self._queue.popleft()
            else:
                self._submit(self._map_next)
            self._queue.append((monotonic(), frame))
            return True

    def flush(self, timeout: float | None = None) -> bool:
        """Wait until no frame waits or is in work; whether it came to that in `timeout` seconds."""
        with self._changed:
            done = self._changed.wait_for(lambda: not (self._queue or self._in_work), timeout)
            self._raise_error()
            return done

    def close(self) -> None:
        """Map what waits, end the session (`Mapper.finish`) and write the map; a second call does nothing.

        Raises
        ------
        InputError
            There is a file to write, and no frame could be used.
        """
        self._shut()
        self._raise_error()

    @property
    def statistics(self) -> LiveStatistics:
        """Counts and latencies so far, all of one moment."""
        with self._changed:
            return LiveStatistics(
                received=self._received,
                mapped=self._mapped,
                skipped=self._skipped,
                dropped=self._dropped,
                waiting=len(self._queue),
                in_work=self._in_work,
                latency=self._latency,
                mean_latency=self._total_latency / max(self._mapped, 1),
                max_latency=self._max_latency,
            )

    def __enter__(self) -> LiveMapper:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        with self._changed:
            self._drop_waiting()
        self._shut()

    def _has_room(self) -> bool:
        return len(self._queue) < self.capacity

    def _over(self) -> bool:
        return self._closed or self._error is not None

    def _raise_error(self) -> None:
        if self._error is not None:
            raise self._error

    def _drop_waiting(self) -> None:
        self._dropped += len(self._queue)
        self._queue.clear()

    def _submit(self, task: Callable[[], None]) -> None:
        self._pool.submit(task).add_done_callback(self._ended)

    def _ended(self, task: Future[None]) -> None:
        """In the mapping thread: a task is done, or failed."""
        with self._changed:
            self._error = self._error or task.exception()
            self._dropped += self._in_work
            self._in_work = 0
            if self._error is not None:
                self._drop_waiting()
            self._changed.notify_all()

    def _map_next(self) -> None:
        with self._changed:
            if not self._queue:
                return
            pushed, frame = self._queue.popleft()
            self._in_work = 1
            self._changed.notify_all()
        fused = self._map(frame)
        latency = monotonic() - pushed
        with self._changed:
            self._in_work = 0
            self._mapped += fused
            self._skipped += not fused
            if fused:
                self._latency, self._max_latency = latency, max(latency, self._max_latency)
                self._total_latency += latency

    def _map(self, frame: Frame) -> bool:
        """Whether the frame was fused."""
        mapper = self.mapper
        try:
            percept = mapper.front_end.perceive(frame)
            mapper.fuse(frame, percept)
        except BadFrameError as error:
            if mapper.config.input.strict:
                raise
            mapper.skip(frame.index, error.found)
            return False
        if percept.skip:
            return False
        if self._output and (self._mapped + 1) % mapper.config.map.checkpoint_every == 0:
            self._write(self._output)
        return True

    def _write(self, output: str | Path) -> None:
        if self._writer is None:
            # In the mapping thread, which alone may use the database then.
            config = self.mapper.config.model_dump_json()
            self._writer = MapWriter.create(output, config, self.mapper.provenance, overwrite=self._overwrite)
        self._writer.checkpoint(self.mapper.checkpoint())

    def _shut(self) -> None:
        with self._changed:
            first, self._closed = not self._closed, True
            self._changed.notify_all()
            if first:
                self._submit(self._finish)
        self._pool.shutdown()

    def _finish(self) -> None:
        with ExitStack() as held:
            held.callback(self.mapper.close)
            held.callback(self._close_file)
            if self._error is not None:
                return
            self.mapper.finish()
            if self._output:
                if not self.mapper.report.frames:
                    advice = "look at what pushes frames"
                    raise nothing_usable("live mapping", self.mapper.report.skipped, advice)
                self._write(self._output)

    def _close_file(self) -> None:
        if self._writer:
            self._writer.close()
