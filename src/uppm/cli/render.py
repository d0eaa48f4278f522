"""`uppm render`: a map seen by a camera, as a sequence of images."""

from __future__ import annotations

from contextlib import suppress
from math import radians, tan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uppm.core.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from uppm.core.types import Intrinsics
    from uppm.map.panoptic_map import PanopticMap

    Posed = tuple[int, npt.NDArray[np.float64]]

SIZE = (640, 480)


def render(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to make.")],
    pose: Annotated[Path | None, typer.Option(metavar="FILE", help="Text file of one pose, T_map_camera.")] = None,
    trajectory: Annotated[
        Path | None, typer.Option(metavar="FILE|SEQUENCE", help="Poses, one a line; or a sequence's poses.")
    ] = None,
    intrinsics: Annotated[Path | None, typer.Option(metavar="FILE", help="Camera matrix 3x3; needs --size.")] = None,
    size: Annotated[tuple[int, int] | None, typer.Option(help="Width and height of the images, pixels.")] = None,
    fov: Annotated[float, typer.Option(min=1, max=170, help="Horizontal field of view, degrees.")] = 60.0,
    stride: Annotated[int, typer.Option(min=1, help="Use every n-th pose.")] = 1,
    max_frames: Annotated[int | None, typer.Option(min=1, help="Stop after so many poses.")] = None,
    depth_range: Annotated[tuple[float, float], typer.Option(help="What is drawn, metres.")] = (0.05, 60.0),
    coco_panoptic: Annotated[bool, typer.Option("--coco-panoptic", help="Add panoptic.json and panoptic/.")] = False,
) -> None:
    """Colour, depth, instance and category images of a map, by casting rays into its submaps."""
    from uppm.core.folders import whole_folder
    from uppm.export.coco_panoptic import CocoPanoptic
    from uppm.export.rendered import begin_sequence, write_view
    from uppm.map.raycast import Raycaster
    from uppm.pipeline import open_map

    if (pose is None) == (trajectory is None):
        found = "neither" if pose is None else "both"
        raise InputError("render", expected="--pose or --trajectory", found=found, advice="name one place to look from")
    panoptic = open_map(path)
    poses, own = _poses(panoptic, pose, trajectory)
    camera = _camera(intrinsics, size, fov, own)
    chosen = poses[::stride][:max_frames]
    with whole_folder(output) as folder:
        caster = Raycaster(panoptic)
        begin_sequence(folder, panoptic.submaps)
        coco = CocoPanoptic(folder, panoptic.submaps) if coco_panoptic else None
        for index, T_map_camera in chosen:
            view = caster.render(T_map_camera, camera, depth_range=depth_range)
            write_view(folder, index, view)
            if coco:
                coco.add(index, view)
        if coco:
            coco.finish()
    typer.echo(f"{output}: {len(chosen)} views of {camera.width}x{camera.height}")


def _poses(panoptic: PanopticMap, pose: Path | None, trajectory: Path | None) -> tuple[list[Posed], Intrinsics | None]:
    """Index and T_map_camera of each view, and the camera where a sequence has one."""
    from uppm.core.config import InputConfig
    from uppm.datasets.poses import read_trajectory

    if trajectory and (trajectory.is_dir() or trajectory.suffix.lower() != ".txt"):
        return _sequence_poses(panoptic, trajectory)
    file = pose or trajectory
    found = read_trajectory(file, InputConfig()) if file else []
    if pose and len(found) > 1:
        raise InputError(pose, expected="one pose", found=f"{len(found)}", advice="give the file as --trajectory")
    return list(enumerate(found)), None


def _sequence_poses(panoptic: PanopticMap, sequence: Path) -> tuple[list[Posed], Intrinsics]:
    """Of the frames whose pose can be used; read with the conventions that the map's own sequence was read with."""
    from uppm.core.errors import BadFrameError
    from uppm.datasets.registry import open_sequence
    from uppm.pipeline import saved_config

    whole = {"format": None, "stride": 1, "max_frames": None}
    source = open_sequence(sequence, saved_config(panoptic.meta).input.model_copy(update=whole))
    poses = []
    for position, index in enumerate(source.indices):
        with suppress(BadFrameError):
            poses.append((index, source.pose(position)))
    return poses, source.raw.color


def _camera(matrix: Path | None, size: tuple[int, int] | None, fov: float, sequence: Intrinsics | None) -> Intrinsics:
    """Of a file, of the sequence scaled to the size, or a plain one with square pixels."""
    from uppm.core.geometry import resized
    from uppm.core.types import Intrinsics
    from uppm.datasets.files import read_intrinsics

    if matrix:
        if size is None:
            advice = "add --size WIDTH HEIGHT of the images that it is of"
            raise InputError(matrix, expected="an image size with the camera matrix", found="none", advice=advice)
        return read_intrinsics(matrix, size)
    if sequence:
        return resized(sequence, *size) if size else sequence
    width, height = size or SIZE
    focal = 0.5 * width / tan(radians(fov) / 2)
    return Intrinsics(fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2, width=width, height=height)
