"""7-Scenes (Shotton et al. 2013) and the demo data of KinectFusion ports in its layout."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from uppm.core.config import InputConfig
from uppm.core.types import Intrinsics
from uppm.datasets import files
from uppm.datasets.sequence import RawFrame, RawSequence

INVALID = 65535


class SevenScenes:
    looks_for = "frame-NNNNNN.color.png, .depth.png, .pose.txt"

    @staticmethod
    def matches(path: Path) -> bool:
        return path.is_dir() and not (path / "_info.txt").exists() and any(path.glob("frame-*.color.*"))

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        color = files.numbered(path, r"frame-(\d+)\.color" + files.IMAGE)
        depth = files.numbered(path, r"frame-(\d+)\.depth\.png")
        frames = [
            RawFrame(
                where=str(path / f"frame-{number:06d}"),
                pose_where=str(path / f"frame-{number:06d}.pose.txt"),
                stamp=number / files.FRAME_RATE,
                color=partial(files.read_color, color.get(number, path / f"frame-{number:06d}.color.png")),
                depth=partial(files.read_depth, depth.get(number, path / f"frame-{number:06d}.depth.png"), INVALID),
                pose=partial(files.read_pose, path / f"frame-{number:06d}.pose.txt"),
            )
            for number in files.paired(color, depth, path)
        ]
        size = files.common_size(color.values(), depth.values(), path)
        source = path / "camera-intrinsics.txt"
        published = Intrinsics(fx=585, fy=585, cx=320, cy=240, width=size[0], height=size[1])
        camera = files.read_intrinsics(source, size) if source.exists() or size != (640, 480) else published
        return RawSequence(
            format="7scenes",
            name=path.resolve().name,
            frames=frames,
            color=camera,
            depth=camera,
            intrinsics_source=str(source),
        )
