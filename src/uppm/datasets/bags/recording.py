"""A recording of ROS messages by topic: what is in it, and each message when it is asked for."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uppm.core.errors import BadFrameError, InputError, MissingExtraError

COMMAND = "pip install uppm[ros]"
NANO = 1e-9


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One message of a topic and where it stands."""

    topic: str
    logged: int
    """Nanoseconds at which it was recorded."""
    turn: int
    """Number among the messages of its topic that were recorded at that same time."""
    stamp: float
    """Seconds: its header's time."""
    frame_id: str


class Recording:
    """An open bag; messages are read from disk when asked for, from any thread.

    Parameters
    ----------
    path : Path
        `.bag`, `.mcap`, `.db3`, or a ROS 2 bag's folder.

    Raises
    ------
    InputError
        The file cannot be read as a bag.
    MissingExtraError
        `rosbags` is not installed.
    """

    def __init__(self, path: Path) -> None:
        try:
            from rosbags.highlevel import AnyReader, AnyReaderError
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise MissingExtraError("rosbags, which reads bags,", COMMAND) from None
        self.path, self._lock, self._errors = path, threading.Lock(), AnyReaderError
        try:
            # A bag of before ROS 2 Iron holds no definitions: its own ones are the standard ones.
            self._reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            self._reader.open()
            weakref.finalize(self, self._reader.close)
        except (AnyReaderError, OSError, ValueError, KeyError) as error:
            found = f"one that cannot be read ({' '.join(str(error).split())[:200]})"
            advice = "copy it again, or repair it (rosbag reindex, ros2 bag reindex, mcap recover)"
            raise InputError(path, expected="a ROS bag", found=found, advice=advice) from None
        self.topics: dict[str, str] = {c.topic: c.msgtype.replace("/msg/", "/") for c in self._reader.connections}
        """Topic -> message type, as `sensor_msgs/Image`."""

    def of_type(self, *types: str) -> list[str]:
        """Topics of these message types, sorted."""
        return sorted(topic for topic, kind in self.topics.items() if kind in types)

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Time recorded, nanoseconds, and message, of all of a topic in that order."""
        connections = [c for c in self._reader.connections if c.topic == topic]
        try:
            with self._lock:
                for connection, logged, data in self._reader.messages(connections):
                    yield logged, self._reader.deserialize(data, connection.msgtype)
        except self._errors as error:
            found = f"a message that cannot be read ({error})"
            raise InputError(
                self.path, expected=f"messages of {topic}", found=found, advice="record it again"
            ) from None

    def entries(self, topic: str) -> list[Entry]:
        """Times of all messages of a topic with headers, in the order of recording."""
        entries: list[Entry] = []
        for logged, message in self.messages(topic):
            turn = entries[-1].turn + 1 if entries and entries[-1].logged == logged else 0
            stamp, frame_id = seconds(message.header.stamp), message.header.frame_id.lstrip("/")
            entries.append(Entry(topic=topic, logged=logged, turn=turn, stamp=stamp, frame_id=frame_id))
        return entries

    def read(self, entry: Entry) -> Any:
        """One message; raises `BadFrameError` where it cannot be read."""
        connections = [c for c in self._reader.connections if c.topic == entry.topic]
        try:
            with self._lock:
                found = self._reader.messages(connections, start=entry.logged, stop=entry.logged + 1)
                for turn, (connection, _, data) in enumerate(found):
                    if turn == entry.turn:
                        return self._reader.deserialize(data, connection.msgtype)
        except (self._errors, OSError) as error:
            raise self._lost(entry, f"one that cannot be read ({error})") from None
        raise self._lost(entry, "none any more")

    def _lost(self, entry: Entry, found: str) -> BadFrameError:
        where = f"{self.path}, {entry.topic} at {entry.stamp:.6f} s"
        return BadFrameError(where, expected="a message", found=found, advice="copy the bag again")

    def listed(self) -> str:
        """All topics with their types, for messages."""
        return ", ".join(f"{topic} ({kind})" for topic, kind in sorted(self.topics.items())) or "no topic at all"


def seconds(stamp: Any) -> float:
    """A header's time in seconds."""
    return stamp.sec + stamp.nanosec * NANO
