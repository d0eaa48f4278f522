"""What a back end must offer: at most two methods each. Public fakes stand in `uppm.perception.fakes`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from uppm.core.language import Caption, FrameLabels
from uppm.core.shown import Content
from uppm.core.types import Category, Detections, Frame, Label, PanopticSegmentation, VoxelBlocks


class FrameSource(Protocol):
    """A posed RGB-D sequence. `frame(n)` raises `BadFrameError` for a frame that cannot be used."""

    @property
    def name(self) -> str: ...

    @property
    def indices(self) -> Sequence[int]:
        """`Frame.index` of each frame."""
        ...

    def __len__(self) -> int: ...

    def frame(self, position: int, /) -> Frame: ...


class Captioner(Protocol):
    """Image -> caption and tags, as an image-to-text model writes them (paper section 3.2.1)."""

    def caption(self, frame: Frame) -> Caption: ...


class Labeler(Protocol):
    """Image -> open-vocabulary labels (paper section 3.2.1, VLFE++); none from closed-set front ends."""

    def label(self, frame: Frame) -> FrameLabels: ...


class Segmenter(Protocol):
    """Image, depth and labels -> panoptic segmentation (paper section 3.2.3)."""

    def prepare(self, frames: Sequence[Frame]) -> None:
        """Look at a few frames spread over the sequence before mapping starts (for gravity, say)."""
        ...

    def segment(self, frame: Frame, labels: Sequence[Label]) -> PanopticSegmentation: ...


@runtime_checkable
class Closable(Protocol):
    """A back end that holds memory or a device until it is closed."""

    def close(self) -> None: ...


class Detector(Protocol):
    """Image and labels -> boxes; a closed-set detector ignores the labels."""

    def detect(self, color: npt.NDArray[np.uint8], labels: Sequence[Label]) -> Detections: ...


class MaskGenerator(Protocol):
    """Boxes -> one mask each, (N, H, W) bool."""

    def masks(self, frame: Frame, boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]: ...


class VisualEncoder(Protocol):
    """Pictures of segments -> unit vectors (N, D) float32."""

    def encode(self, color: npt.NDArray[np.uint8], boxes: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]: ...


class TextEncoder(Protocol):
    """Texts -> unit vectors (N, D) float32; the same text always gives the same vector."""

    def encode(self, texts: Sequence[str]) -> npt.NDArray[np.float32]: ...


class Retriever(Protocol):
    """Label text -> unified category (paper equation 1)."""

    def retrieve(self, texts: Sequence[str]) -> tuple[Category, ...]: ...


class VoxelSource(Protocol):
    """Where a map's voxels are: the running fusion, or a map file."""

    def blocks(self, submap_id: int) -> VoxelBlocks: ...


class LiveVoxels(Protocol):
    """Voxels that change: what a mesh that follows them must know."""

    def touched(self, submap_id: int, /) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """Coordinates of a submap's blocks, (N, 3), and of those written since the last call, (M, 3)."""
        ...

    def blocks_at(self, submap_id: int, coords: npt.NDArray[np.int32], /) -> VoxelBlocks:
        """The blocks at some coordinates, (N, 3), all of which exist, sorted."""
        ...


class Progress(Protocol):
    """Told of each frame of a run."""

    def __call__(self, done: int, total: int) -> None: ...


class FrameViewer(Protocol):
    """Watches the mapping; the default does nothing."""

    def show(self, frame: Frame, submap_ids: npt.NDArray[np.int32], content: Callable[[float], Content], /) -> None:
        """A frame was fused; `content`, to be called before returning if at all, meshes for so many seconds."""
        ...
