"""HoloLens walks in the layout of the deep-video-mvs sample."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from uppm.core.config import InputConfig
from uppm.datasets import files
from uppm.datasets.sequence import RawFrame, RawSequence


class HoloLens:
    looks_for = "images/, depth/, poses.txt, K.txt"

    @staticmethod
    def matches(path: Path) -> bool:
        return (path / "images").is_dir() and (path / "poses.txt").exists()

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        color = files.numbered(path / "images", r"(\d+)" + files.IMAGE)
        depth = files.numbered(path / "depth", r"(\d+)\.png")
        numbers = files.paired(color, depth, path)
        poses = files.pose_lines(path / "poses.txt", len(numbers))
        frames = [
            RawFrame(
                where=f"{path}, image {number:05d}",
                pose_where=f"{path / 'poses.txt'}, line {i + 1} (image {number:05d})",
                stamp=number / files.FRAME_RATE,
                color=partial(files.read_color, color.get(number, path / "images" / f"{number:05d}.png")),
                depth=partial(files.read_depth, depth.get(number, path / "depth" / f"{number:05d}.png")),
                pose=poses[i].copy,
            )
            for i, number in enumerate(numbers)
        ]
        camera = files.read_intrinsics(path / "K.txt", files.common_size(color.values(), depth.values(), path))
        return RawSequence(
            format="hololens",
            name=path.resolve().name,
            frames=frames,
            color=camera,
            depth=camera,
            intrinsics_source=str(path / "K.txt"),
        )
