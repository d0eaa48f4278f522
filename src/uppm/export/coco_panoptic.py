"""Rendered views in COCO's panoptic format: `panoptic.json`, and a PNG a view in `panoptic/`.

Kirillov et al., "Panoptic Segmentation", CVPR 2019, and cocodataset.org/#format-data: a pixel holds its segment's id as
R + 256 G + 65536 B, 0 where there is none, and the JSON says of each image's segments which category they are of.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.core.types import Category, Submap, SubmapKind
from uppm.core.views import RenderedView
from uppm.export.files import write_json, write_png

NAME = "panoptic"
MAX_ID = (1 << 24) - 1


class CocoPanoptic:
    """Writes views one by one, and the JSON at the end.

    A category of which the map has an object is one of things, and each of its submaps a segment of the submap's id. Of
    any other category there is one segment an image, as COCO has it for stuff: all its submaps, under the least id.

    Parameters
    ----------
    folder : to write in; it has no `panoptic` yet.
    submaps : the map's.

    Raises
    ------
    InputError
        An id does not fit into 24 bits.
    """

    def __init__(self, folder: Path, submaps: Iterable[Submap]) -> None:
        labeled = [(s, s.descriptor.category) for s in sorted(submaps, key=lambda s: s.id) if s.descriptor]
        if labeled and labeled[-1][0].id > MAX_ID:
            found, advice = str(labeled[-1][0].id), "map the sequence anew"
            raise InputError(folder / NAME, expected=f"submap ids up to {MAX_ID}", found=found, advice=advice)
        self._folder = folder
        self._things = {category.id for s, category in labeled if s.kind is SubmapKind.OBJECT}
        self._categories: dict[int, Category] = {category.id: category for _, category in labeled}
        self._category_of: dict[int, int] = {}
        least: dict[int, int] = {}
        self._segment_of: dict[int, int] = {}
        for submap, category in labeled:
            stuff = category.id not in self._things
            segment = least.setdefault(category.id, submap.id) if stuff else submap.id
            self._segment_of[submap.id], self._category_of[segment] = segment, category.id
        self._images: list[dict[str, Any]] = []
        self._annotations: list[dict[str, Any]] = []
        (folder / NAME).mkdir()

    def add(self, index: int, view: RenderedView) -> None:
        """One view, as image `index`."""
        name = f"{index:05d}.png"
        ids, inverse = np.unique(view.instance, return_inverse=True)
        segments = np.array([self._segment_of.get(id_, 0) for id_ in ids.tolist()])[
            inverse.reshape(view.instance.shape)
        ]
        channels = [segments & 255, segments >> 8 & 255, segments >> 16]
        write_png(self._folder / NAME / name, np.stack(channels, axis=-1).astype(np.uint8))
        camera = view.intrinsics
        self._images.append({"id": index, "file_name": name, "width": camera.width, "height": camera.height})
        rows = [self._row(id_, segments == id_) for id_ in np.unique(segments[segments > 0]).tolist()]
        self._annotations.append({"image_id": index, "file_name": name, "segments_info": rows})

    def finish(self) -> None:
        """Write the JSON."""
        categories = [
            {"id": c.id, "name": c.name, "supercategory": c.supercategory, "isthing": int(c.id in self._things)}
            for _, c in sorted(self._categories.items())
        ]
        document = {"images": self._images, "annotations": self._annotations, "categories": categories}
        write_json(self._folder / f"{NAME}.json", document)

    def _row(self, segment: int, pixels: npt.NDArray[np.bool_]) -> dict[str, Any]:
        return {
            "id": segment,
            "category_id": self._category_of[segment],
            "area": int(pixels.sum()),
            "bbox": list(cv2.boundingRect(pixels.astype(np.uint8))),
            "iscrowd": 0,
        }
