"""Rendered views as a sequence of the `frames` layout, instances included, for every command that reads one."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from uppm.core.errors import InputError
from uppm.core.types import Submap, SubmapKind
from uppm.core.views import RenderedView
from uppm.export.files import write_bytes, write_png

MILLIMETRES = 1000.0
MAX_16_BIT = 65535
IMAGES = ("color", "depth", "instance", "category")


def begin_sequence(folder: Path, submaps: Iterable[Submap]) -> None:
    """Make the subfolders and `labels.csv`: the name, the kind and the unified category of each id.

    Raises
    ------
    InputError
        An id does not fit into 16 bits, or nothing can be written there.
    """
    for name in (*IMAGES, "pose"):
        (folder / name).mkdir()
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(("instance", "name", "thing", "categories"))
    for submap in submaps:
        if submap.descriptor is None:
            continue
        if submap.id > MAX_16_BIT:
            expected, advice = f"submap ids up to {MAX_16_BIT}", "map the sequence anew"
            raise InputError(folder / "instance", expected=expected, found=str(submap.id), advice=advice)
        descriptor = submap.descriptor
        name = descriptor.labels[0].text if descriptor.labels else descriptor.category.name
        writer.writerow((submap.id, name, int(submap.kind is SubmapKind.OBJECT), descriptor.category.name))
    write_bytes(folder / "labels.csv", table.getvalue().encode())


def write_view(folder: Path, index: int, view: RenderedView) -> None:
    """One view as frame `index`: PNGs of colour, depth (16 bits, millimetres), instance and category, and the pose.

    What is farther than 65.535 m has no depth; the unlabeled background has no instance.
    """
    name, camera = f"{index:05d}.png", view.intrinsics
    millimetres = np.rint(view.depth * MILLIMETRES)
    write_png(folder / "color" / name, view.color)
    write_png(folder / "depth" / name, np.where(millimetres <= MAX_16_BIT, millimetres, 0).astype(np.uint16))
    write_png(folder / "instance" / name, np.where(view.category > 0, view.instance, 0).astype(np.uint16))
    write_png(folder / "category" / name, view.category.astype(np.uint16))
    rows = "\n".join(" ".join(f"{value:.9g}" for value in row) for row in view.T_map_camera)
    write_bytes(folder / "pose" / f"{index:05d}.txt", f"{rows}\n".encode())
    matrix = "\n".join(" ".join(f"{value:.9g}" for value in row) for row in camera.matrix)
    write_bytes(folder / "intrinsics.txt", f"{matrix}\n".encode())
