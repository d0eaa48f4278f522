"""Replica rendered as in NICE-SLAM's release: results/, traj.txt, cam_params.json."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from uppm.core.config import InputConfig
from uppm.core.errors import InputError
from uppm.core.types import Intrinsics
from uppm.datasets import files
from uppm.datasets.sequence import RawFrame, RawSequence


class Replica:
    looks_for = "results/frameNNNNNN.jpg, results/depthNNNNNN.png, traj.txt, cam_params.json here or one folder up"

    @staticmethod
    def matches(path: Path) -> bool:
        return (path / "results").is_dir() and (path / "traj.txt").exists()

    @staticmethod
    def read(path: Path, config: InputConfig) -> RawSequence:
        folder = path / "results"
        color = files.numbered(folder, r"frame(\d+)" + files.IMAGE)
        depth = files.numbered(folder, r"depth(\d+)\.png")
        numbers = files.paired(color, depth, folder)
        poses = files.pose_lines(path / "traj.txt", len(numbers))
        frames = [
            RawFrame(
                where=f"{path}, image {number:06d}",
                pose_where=f"{path / 'traj.txt'}, line {i + 1} (image {number:06d})",
                stamp=number / files.FRAME_RATE,
                color=partial(files.read_color, color.get(number, folder / f"frame{number:06d}.jpg")),
                depth=partial(files.read_depth, depth.get(number, folder / f"depth{number:06d}.png")),
                pose=poses[i].copy,
            )
            for i, number in enumerate(numbers)
        ]
        size = files.common_size(color.values(), depth.values(), path)
        source = path / "cam_params.json"
        source = source if source.exists() else path.resolve().parent / "cam_params.json"
        camera, scale = _camera(source, size)
        return RawSequence(
            format="replica",
            name=path.resolve().name,
            frames=frames,
            color=camera,
            depth=camera,
            depth_scale=scale,
            intrinsics_source=str(source),
        )


def _camera(path: Path, size: tuple[int, int]) -> tuple[Intrinsics, float]:
    text = files.read_text(path)
    try:
        values = json.loads(text)["camera"]
        w, h, fx, fy, cx, cy, scale = (float(values[key]) for key in ("w", "h", "fx", "fy", "cx", "cy", "scale"))
    except (KeyError, TypeError, ValueError) as error:
        expected = '{"camera": {"w", "h", "fx", "fy", "cx", "cy", "scale"}} with numbers'
        raise InputError(path, expected=expected, found=f"{error!r}", advice="restore the file") from None
    if (w, h) != size:
        found = f"images of {size[0]}x{size[1]}"
        raise InputError(path, expected=f"images of {w:.0f}x{h:.0f}", found=found, advice="give their camera")
    return Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, width=size[0], height=size[1]), scale
