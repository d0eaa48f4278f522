"""What a viewer costs mapping: without one, with a browser that reads, one that is slow and one that stalls, in turn.

    python benchmarks/live_viewer.py SEQUENCE [--repeat 4] [--rounds 3]

A process of its own stands for the browser: it opens the page's web socket and reads all, a message a second, or
nothing, so that no rendering on the same cores is measured. The sequence is mapped several times over, from memory;
every other round takes the cases in the opposite order. Prints the seconds of `Mapper.integrate` and their ratio to the
run without a viewer of the same round (median, and of each round), the share of them that the thread which maps was in
the viewer (by the same clock, so that it holds on a busy machine too), and the processor seconds of all threads with
their ratio.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from urllib.parse import urlsplit

import numpy as np
import numpy.typing as npt

from uppm.core.config import Config
from uppm.core.shown import Content
from uppm.core.types import Frame
from uppm.datasets.registry import open_sequence
from uppm.pipeline import Mapper, spread_frames
from uppm.viewer.live import LiveViewer
from uppm.viewer.served import ServedMap

CLIENT = """
import sys, time
import viser
from websockets.sync.client import connect
address, case = sys.argv[1:]
with connect(address, subprotocols=["viser-v" + viser.__version__], max_size=None) as socket:
    print("open", flush=True)
    while case != "stalls":
        socket.recv()
        time.sleep(1 if case == "slow" else 0)
    time.sleep(3600)
"""
CASES = ("none", "reads", "slow", "stalls")


class Timed(LiveViewer):
    """Adds up how long the thread that maps is in it."""

    seconds = 0.0

    def show(self, frame: Frame, submap_ids: npt.NDArray[np.int32], content: Callable[[float], Content], /) -> None:
        """As it is, and timed."""
        start = time.perf_counter()
        super().show(frame, submap_ids, content)
        self.seconds += time.perf_counter() - start


def run(frames: Sequence[Frame], config: Config, case: str) -> tuple[float, float, float, int]:
    """Seconds, processor seconds, seconds in the viewer, and maps shown, of one run."""
    if case == "none":
        return *mapped(frames, Mapper(config)), 0.0, 0
    served, shown = ServedMap(port=0), []

    def show(content: Content) -> None:
        served.show(content)
        shown.append(content)

    viewer = Timed(show, lambda: True)
    address = f"ws://127.0.0.1:{urlsplit(served.url).port}"
    client = subprocess.Popen([sys.executable, "-c", CLIENT, address, case], stdout=subprocess.PIPE)
    try:
        assert client.stdout is not None
        client.stdout.readline()
        return *mapped(frames, Mapper(config, viewer=viewer)), viewer.seconds, len(shown)
    finally:
        client.kill()
        client.wait()
        viewer.close()
        served.close()


def mapped(frames: Sequence[Frame], mapper: Mapper) -> tuple[float, float]:
    """Seconds and processor seconds of mapping."""
    mapper.prepare(frames[:: max(1, len(frames) // 12)])
    start, processor = time.perf_counter(), time.process_time()
    for frame in frames:
        mapper.integrate(frame)
    return time.perf_counter() - start, time.process_time() - processor


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("sequence")
    parser.add_argument("--repeat", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    config = Config.load(None, ["perception.profile=groundtruth"])
    source = open_sequence(given.sequence, config.input)
    frames = [source.frame(n) for n in range(len(source))] * given.repeat
    warm = Mapper(config)
    mapped(spread_frames(source), warm)  # compiles
    warm.meshes()
    orders = [CASES if n % 2 == 0 else CASES[::-1] for n in range(given.rounds)]
    rounds = [{case: run(frames, config, case) for case in order} for order in orders]
    for case in CASES:

        def median(of: Callable[[dict[str, tuple[float, ...]], str], float], case: str = case) -> float:
            return statistics.median(of(r, case) for r in rounds)

        line = {
            "viewer": case,
            "seconds": round(median(lambda r, c: r[c][0]), 2),
            "ratio": round(median(lambda r, c: r[c][0] / r["none"][0]), 3),
            "ratios": [round(r[case][0] / r["none"][0], 3) for r in rounds],
            "share_in_viewer": round(median(lambda r, c: r[c][2] / r[c][0]), 4),
            "processor_seconds": round(median(lambda r, c: r[c][1]), 2),
            "processor_ratio": round(median(lambda r, c: r[c][1] / r["none"][1]), 3),
            "maps_shown": round(median(lambda r, c: r[c][3])),
        }
        print(json.dumps(line))


if __name__ == "__main__":
    main()
