"""Frames pushed from any thread: what each policy does with a full queue, and that nothing is lost uncounted."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import uppm
from uppm.core.errors import BadFrameError, InputError, MapFileError, UppmError
from uppm.core.language import FrameLabels
from uppm.core.types import Frame
from uppm.live import Policy
from uppm.perception.fakes import FakeRetriever, FakeSegmenter, fake_frame

LONG = 60.0
"""Seconds after which a test that hangs fails."""
CONFIG = uppm.Config.load(None, ["fusion.max_blocks=20000", "map.checkpoint_every=2"])


class Gate(FakeSegmenter):
    """Says that a frame is in work, and holds it until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[int] = []
        self.in_work, self.open = threading.Semaphore(0), threading.Semaphore(0)

    def segment(self, frame: Frame, labels=()):
        self.seen.append(frame.index)
        self.in_work.release()
        assert self.open.acquire(timeout=LONG)
        return super().segment(frame, labels)

    def wait_for_work(self) -> None:
        assert self.in_work.acquire(timeout=LONG)

    def let_go(self, count: int) -> None:
        self.open.release(count)


def mapper(segmenter: FakeSegmenter | None = None, **others) -> uppm.Mapper:
    return uppm.Mapper(CONFIG, segmenter=segmenter or FakeSegmenter(), retriever=FakeRetriever(), **others)


def assert_all_counted(live: uppm.LiveMapper) -> None:
    s = live.statistics
    assert s.received == s.mapped + s.skipped + s.dropped + s.waiting + s.in_work


@contextmanager
def full_queue(policy: Policy) -> Iterator[tuple[uppm.LiveMapper, Gate]]:
    """Frame 0 in work, frames 1 and 2 waiting: no room for another."""
    gate = Gate()
    live = uppm.LiveMapper(mapper(gate), capacity=2, policy=policy)
    assert live.push(fake_frame(0))
    gate.wait_for_work()
    assert live.push(fake_frame(1))
    assert live.push(fake_frame(2))
    assert (live.statistics.waiting, live.statistics.in_work, live.statistics.mapped) == (2, 1, 0)
    yield live, gate
    gate.let_go(10)
    live.close()
    assert_all_counted(live)
    assert (live.statistics.waiting, live.statistics.in_work) == (0, 0)


def test_drop_oldest_forgets_what_waits_longest() -> None:
    with full_queue("drop-oldest") as (live, gate):
        assert live.push(fake_frame(3))
        assert live.push(fake_frame(4))
        assert (live.statistics.received, live.statistics.dropped, live.statistics.waiting) == (5, 2, 2)
        assert_all_counted(live)
    assert gate.seen == [0, 3, 4]
    assert live.statistics.mapped == 3


def test_drop_newest_refuses_the_new_frame() -> None:
    with full_queue("drop-newest") as (live, gate):
        assert not live.push(fake_frame(3))
        assert (live.statistics.received, live.statistics.dropped, live.statistics.waiting) == (4, 1, 2)
    assert gate.seen == [0, 1, 2]


def test_block_waits_until_there_is_room() -> None:
    with full_queue("block") as (live, gate):
        assert not live.push(fake_frame(3), timeout=0)
        assert live.statistics.dropped == 1
        pushing = threading.Thread(target=live.push, args=(fake_frame(4),))
        pushing.start()
        gate.let_go(1)
        gate.wait_for_work()  # frame 1 is in work, which left room in the queue
        pushing.join(LONG)
        assert not pushing.is_alive()
        assert live.statistics.waiting == 2
    assert gate.seen == [0, 1, 2, 4]
    assert live.statistics.dropped == 1


def test_closing_lets_a_blocked_thread_know() -> None:
    told: list[str] = []

    def push(live: uppm.LiveMapper) -> None:
        with pytest.raises(UppmError, match="this LiveMapper is closed") as error:
            live.push(fake_frame(3))
        told.append(str(error.value))

    with full_queue("block") as (live, gate):
        threads = [threading.Thread(target=push, args=(live,)), threading.Thread(target=live.close)]
        for thread in threads:
            thread.start()
        threads[0].join(LONG)
        gate.let_go(10)
        threads[1].join(LONG)
    assert told
    assert gate.seen == [0, 1, 2]
    live.close()
    push(live)


def test_many_threads_push_and_every_frame_is_mapped_once(tmp_path: Path) -> None:
    path, count = tmp_path / "live.uppm", 4
    start = threading.Barrier(count)
    with uppm.LiveMapper(mapper(), capacity=2, policy="block", output=path) as live:

        def push(thread: int) -> None:
            start.wait(LONG)
            for n in range(5):
                assert live.push(fake_frame(5 * thread + n))

        threads = [threading.Thread(target=push, args=(n,)) for n in range(count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(LONG)
        assert live.flush(LONG)
        assert live.statistics.mapped == 20
        assert live.mapper.map.query("chair").found
    found = uppm.open_map(path)
    assert sorted(record.index for record in found.frames) == list(range(20))
    order = [record.index for record in live.mapper.map.frames]
    assert all([n for n in order if n // 5 == thread] == list(range(5 * thread, 5 * thread + 5)) for thread in range(4))
    assert found.to_dict()["submaps"] == live.mapper.map.to_dict()["submaps"]
    assert live.statistics.max_latency >= live.statistics.mean_latency > 0
    assert live.statistics.max_latency >= live.statistics.latency > 0


def test_a_mapper_may_be_called_from_several_threads() -> None:
    shared, alone = mapper(), mapper()
    start = threading.Barrier(3)
    images: dict[int, np.ndarray] = {}

    def integrate(thread: int) -> None:
        start.wait(LONG)
        for n in range(4):
            images[4 * thread + n] = shared.integrate(fake_frame(4 * thread + n))
            assert shared.map.report.frames
            assert shared.meshes()

    threads = [threading.Thread(target=integrate, args=(n,)) for n in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LONG)
    for n in range(12):
        expected = alone.integrate(fake_frame(n))
    assert len(images) == 12
    assert all(np.array_equal(image, expected) for image in images.values())
    for found, wanted in zip(shared.map.submaps, alone.map.submaps, strict=True):
        np.testing.assert_allclose(found.bounds, wanted.bounds, atol=1e-6)
    assert shared.report.frames == 12


class Breaking(FakeSegmenter):
    """Fails at one frame, with the error given."""

    def __init__(self, error: Exception, at: int = 1) -> None:
        super().__init__()
        self.error, self.at = error, at

    def segment(self, frame: Frame, labels=()):
        if frame.index == self.at:
            raise self.error
        return super().segment(frame, labels)


def test_an_error_of_the_mapping_thread_reaches_whoever_calls_next() -> None:
    live = uppm.LiveMapper(mapper(Breaking(ZeroDivisionError("of the model"))), capacity=8, policy="block")
    live.push(fake_frame(0))
    assert live.flush(LONG)
    live.push(fake_frame(1))
    for call in (live.flush, lambda: live.push(fake_frame(3)), live.close):
        with pytest.raises(ZeroDivisionError, match="of the model"):
            call()
    assert (live.statistics.mapped, live.statistics.dropped) == (1, 1)
    assert_all_counted(live)


def test_an_error_wakes_who_waits_for_room() -> None:
    gate = Gate()
    live = uppm.LiveMapper(mapper(gate), capacity=1, policy="block")
    live.push(fake_frame(0))
    gate.wait_for_work()
    live.push(fake_frame(1))
    raised: list[str] = []

    def push() -> None:
        with pytest.raises(MemoryError) as error:
            live.push(fake_frame(2))
        raised.append(str(error.value))

    thread = threading.Thread(target=push)
    live.mapper.fuse = failing  # pyright: ignore[reportAttributeAccessIssue]
    thread.start()
    gate.let_go(1)
    thread.join(LONG)
    assert raised == ["of the map"]
    assert live.statistics.dropped == 2
    with pytest.raises(MemoryError):
        live.close()


def failing(*_) -> None:
    raise MemoryError("of the map")


def test_what_cannot_be_used_is_skipped_and_counted_unless_strict() -> None:
    bad = BadFrameError("frame 1", expected="a usable frame", found="a bad one", advice="skip it")

    class Refusing:
        def label(self, frame: Frame) -> FrameLabels:
            return FrameLabels(labels=(), skip="blurred" if frame.index == 2 else None)

    with uppm.LiveMapper(mapper(Breaking(bad), labeler=Refusing()), policy="block") as live:
        for n in range(4):
            live.push(fake_frame(n))
    assert (live.statistics.mapped, live.statistics.skipped) == (2, 2)
    assert live.mapper.report.skipped == {"a bad one": 1, "blurred": 1}
    strict = mapper(Breaking(bad))
    strict.config = uppm.Config.load(None, ["input.strict=true"])
    live = uppm.LiveMapper(strict)
    live.push(fake_frame(1))
    with pytest.raises(BadFrameError, match="a bad one"):
        live.flush(LONG)


def test_a_block_that_fails_keeps_what_was_mapped(tmp_path: Path) -> None:
    gate, path = Gate(), tmp_path / "live.uppm"
    live = uppm.LiveMapper(mapper(gate), capacity=2, output=path)

    def robot() -> None:
        with live:
            live.push(fake_frame(0))
            gate.wait_for_work()
            live.push(fake_frame(1))
            with live.mapper.lock:  # frame 0 cannot be fused before the block has failed
                gate.let_go(5)
                raise KeyError("of the robot")

    with pytest.raises(KeyError, match="of the robot"):
        robot()
    assert_all_counted(live)
    assert live.statistics.mapped >= 1
    assert uppm.open_map(path).report.frames == live.statistics.mapped


def test_wrong_arguments_and_files_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="policy: expected one of drop-oldest, drop-newest, block, found 'drop'"):
        uppm.LiveMapper(mapper(), policy="drop")  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="capacity: expected at least 1, found 0"):
        uppm.LiveMapper(mapper(), capacity=0)
    path = tmp_path / "live.uppm"
    with pytest.raises(InputError, match="live mapping: expected frames that can be used, found none"):
        uppm.LiveMapper(mapper(), output=path).close()
    assert not path.exists()
    path.write_bytes(b"something")
    with pytest.raises(MapFileError, match="--overwrite"):
        uppm.LiveMapper(mapper(), output=path)
