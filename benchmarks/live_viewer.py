"""What a viewer costs mapping: runs without one, with a browser that reads and with one that never does, in turn.

    python benchmarks/live_viewer.py SEQUENCE [--repeat 4] [--rounds 3]

A process of its own stands for the browser: it opens the page's web socket and reads all, or nothing, so that no
rendering on the same cores is measured. The sequence is mapped several times over, from memory. Prints seconds and
processor seconds (all threads) of `Mapper.integrate`, and their ratio to the run without a viewer of the same round.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from urllib.parse import urlsplit

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
address, reads = sys.argv[1], sys.argv[2] == "reads"
with connect(address, subprotocols=["viser-v" + viser.__version__], max_size=None) as socket:
    print("open", flush=True)
    while reads:
        socket.recv()
    time.sleep(3600)
"""
CASES = ("none", "reads", "stalls")


def run(frames: Sequence[Frame], config: Config, case: str) -> tuple[float, float, int]:
    """Seconds, processor seconds, and maps shown, of one run."""
    if case == "none":
        return *mapped(frames, Mapper(config)), 0
    served, shown = ServedMap(port=0), []

    def show(content: Content) -> None:
        served.show(content)
        shown.append(content)

    viewer = LiveViewer(show, lambda: True)
    address = f"ws://127.0.0.1:{urlsplit(served.url).port}"
    client = subprocess.Popen([sys.executable, "-c", CLIENT, address, case], stdout=subprocess.PIPE)
    try:
        assert client.stdout is not None
        client.stdout.readline()
        return *mapped(frames, Mapper(config, viewer=viewer)), len(shown)
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
    rounds = [{case: run(frames, config, case) for case in CASES} for _ in range(given.rounds)]
    for case in CASES:
        ratios = [[r[case][k] / r["none"][k] for r in rounds] for k in (0, 1)]
        line = {
            "viewer": case,
            "seconds": round(statistics.median(r[case][0] for r in rounds), 2),
            "processor_seconds": round(statistics.median(r[case][1] for r in rounds), 2),
            "ratio": round(statistics.median(ratios[0]), 3),
            "processor_ratio": round(statistics.median(ratios[1]), 3),
            "maps_shown": round(statistics.median(r[case][2] for r in rounds)),
        }
        print(json.dumps(line))


if __name__ == "__main__":
    main()
