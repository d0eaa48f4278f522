"""Deterministic stand-ins for every Protocol of `uppm.core.protocols`, for tests: the package's own and its users'."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from uppm.core.categories import unified_categories
from uppm.core.errors import BadFrameError
from uppm.core.language import Caption, FrameLabels
from uppm.core.shown import Content
from uppm.core.types import (
    VOXELS_PER_SIDE,
    Category,
    Detections,
    Frame,
    Intrinsics,
    Label,
    PanopticSegmentation,
    Provenance,
    Segment,
    VoxelBlocks,
)


def fake_frame(index: int = 0, height: int = 48, width: int = 64, depth: float = 2.0) -> Frame:
    """A frame that looks at a wall `depth` metres away, its left half red and its right half blue."""
    color = np.zeros((height, width, 3), dtype=np.uint8)
    color[:, : width // 2, 0] = 200
    color[:, width // 2 :, 2] = 200
    k = Intrinsics(fx=width, fy=width, cx=(width - 1) / 2, cy=(height - 1) / 2, width=width, height=height)
    flat = np.full((height, width), depth, dtype=np.float32)
    return Frame(index=index, stamp=index / 10, color=color, depth=flat, T_map_camera=np.eye(4), intrinsics=k)


class FakeFrameSource:
    """FrameSource of `count` equal frames; those at the positions in `bad` raise BadFrameError."""

    def __init__(self, count: int = 3, bad: Sequence[int] = (), name: str = "fake") -> None:
        self.name, self.indices, self._bad = name, range(count), frozenset(bad)

    def __len__(self) -> int:
        return len(self.indices)

    def frame(self, position: int) -> Frame:
        """The frame at `position`, whose index is the same."""
        if position in self._bad:
            raise BadFrameError(f"frame {position}", expected="a usable frame", found="a bad one", advice="skip it")
        return fake_frame(self.indices[position])


class FakeCaptioner:
    """Captioner that says the same of every frame, or what `by_index` has for the frame's index."""

    def __init__(self, text: str = "", tags: Sequence[str] = (), by_index: Mapping[int, Caption] | None = None) -> None:
        self._caption, self._by_index = Caption(text=text, tags=tuple(tags)), dict(by_index or {})

    def caption(self, frame: Frame) -> Caption:
        """The caption given at construction."""
        return self._by_index.get(frame.index, self._caption)


class FakeLabeler:
    """Labeler that says the same of every frame."""

    def __init__(self, *texts: str) -> None:
        labels = tuple(Label(text=text, provenance=Provenance.CAPTION) for text in texts)
        self._labels = FrameLabels(labels=labels)

    def label(self, frame: Frame) -> FrameLabels:
        """The labels given at construction."""
        return self._labels


class FakeDetector:
    """Detector that finds the left half of every image and calls it by the first label, or `default`."""

    def __init__(self, default: str = "chair", score: float = 0.9) -> None:
        self._default, self._score = Label(text=default, provenance=Provenance.DETECTOR), score

    def detect(self, color: npt.NDArray[np.uint8], labels: Sequence[Label] = ()) -> Detections:
        """One box, from the left border to the middle."""
        height, width = color.shape[:2]
        return Detections(
            boxes=np.array([[0, 0, width // 2, height]], dtype=np.float32),
            scores=np.array([self._score], dtype=np.float32),
            labels=(labels[0] if labels else self._default,),
        )


class FakeMaskGenerator:
    """MaskGenerator that takes the whole box."""

    def masks(self, frame: Frame, boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """(N, H, W): the boxes, rounded."""
        out = np.zeros((len(boxes), *frame.depth.shape), dtype=bool)
        for mask, (x0, y0, x1, y1) in zip(out, np.round(boxes).astype(int), strict=True):
            mask[max(y0, 0) : y1, max(x0, 0) : x1] = True
        return out


class FakeSegmenter:
    """Segmenter that sees a thing in the left half of every image and a wall in the right half."""

    def __init__(self, thing: str = "chair", stuff: str = "wall") -> None:
        self.prepared = 0
        self._segments = tuple(
            Segment(label=Label(text=text, provenance=Provenance.DETECTOR), score=0.9, is_thing=text == thing)
            for text in (thing, stuff)
        )

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Count the frames."""
        self.prepared += len(frames)

    def segment(self, frame: Frame, labels: Sequence[Label] = ()) -> PanopticSegmentation:
        """Two segments, each half the image."""
        ids = np.full(frame.depth.shape, 2, dtype=np.int32)
        ids[:, : frame.intrinsics.width // 2] = 1
        return PanopticSegmentation(ids=ids, segments=self._segments, dropped={"unlabeled_pixels": 0})


class FakeVisualEncoder:
    """VisualEncoder whose vectors are the box's mean colour, of unit length."""

    def encode(self, color: npt.NDArray[np.uint8], boxes: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
        """(N, 3)."""
        means = [color[y0:y1, x0:x1].reshape(-1, 3).mean(axis=0) + 1 for x0, y0, x1, y1 in boxes.tolist()]
        out = np.array(means, dtype=np.float32).reshape(-1, 3)
        return out / np.linalg.norm(out, axis=1, keepdims=True)


class FakeTextEncoder:
    """TextEncoder whose unit vectors are seeded by a hash of the text: any two texts are nearly orthogonal."""

    def __init__(self, dimensions: int = 64) -> None:
        self._dimensions = dimensions

    def encode(self, texts: Sequence[str]) -> npt.NDArray[np.float32]:
        """(N, dimensions)."""
        out = np.empty((len(texts), self._dimensions), dtype=np.float32)
        for row, text in zip(out, texts, strict=True):
            seed = int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
            row[:] = np.random.default_rng(seed).standard_normal(self._dimensions)
        return out / np.linalg.norm(out, axis=1, keepdims=True)


class FakeRetriever:
    """Retriever by a table of label -> category name; a label that is not in it gives the category of its own name."""

    def __init__(self, table: Mapping[str, str] | None = None, default: str = "solid-other") -> None:
        by_name = {category.name: category for category in unified_categories()}
        self._by_name, self._table, self._default = by_name, dict(table or {}), by_name[default]

    def retrieve(self, texts: Sequence[str]) -> tuple[Category, ...]:
        """One category a text."""
        return tuple(self._by_name.get(self._table.get(text, text), self._default) for text in texts)


class FakeVoxelSource:
    """VoxelSource with one block for every submap, half full of surface."""

    def blocks(self, submap_id: int) -> VoxelBlocks:
        """A flat surface through the middle of block (submap_id, 0, 0)."""
        n = VOXELS_PER_SIDE
        height = (np.arange(n) + 0.5 - n / 2) / (n / 2)
        distance = np.tile((height * 32767).astype(np.int16), (1, n, n, 1))
        belonging = np.zeros((1, n, n, n, 2), dtype=np.uint8)
        belonging[..., 0] = 1
        return VoxelBlocks(
            coords=np.array([[submap_id, 0, 0]], dtype=np.int32),
            distance=distance,
            weight=np.ones((1, n, n, n), dtype=np.float32),
            color=np.full((1, n, n, n, 3), 128, dtype=np.uint8),
            belonging=belonging,
        )


class FakeFrameViewer:
    """FrameViewer that remembers the indices of the frames it was shown."""

    def __init__(self) -> None:
        self.shown: list[int] = []

    def show(self, frame: Frame, submap_ids: npt.NDArray[np.int32], content: Callable[[float], Content]) -> None:
        """Note the frame."""
        self.shown.append(frame.index)
