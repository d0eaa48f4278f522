"""The values that cross stages: frozen, keyword-only, validated once.

Frames of reference: `map` (metres, fixed), `camera` (OpenCV axes: x right, y down, z forward), `submap`.
`T_a_b` maps a point in frame b to frame a. H, W: image height and width in pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import numpy.typing as npt

from uppm.core.features import VisualFeature
from uppm.core.validation import check_array, check_pose, check_range

VOXELS_PER_SIDE = 8
"""Voxels along each side of a block."""


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """Pinhole camera: u = fx * x / z + cx, v = fy * y / z + cy, with integer pixel centres."""

    fx: float
    """Focal length along x, pixels."""
    fy: float
    """Focal length along y, pixels."""
    cx: float
    """Principal point, pixels."""
    cy: float
    """Principal point, pixels."""
    width: int
    """Image width W, pixels."""
    height: int
    """Image height H, pixels."""

    def __post_init__(self) -> None:
        check_range("intrinsics width", self.width, 1, 1 << 16)
        check_range("intrinsics height", self.height, 1, 1 << 16)
        check_range("intrinsics fx", self.fx, 1e-3, 1e6)
        check_range("intrinsics fy", self.fy, 1e-3, 1e6)

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """The 3x3 camera matrix K."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundTruth:
    """What is known of one frame: the instance of each pixel, and the name of each instance."""

    instance: npt.NDArray[np.int32]
    """(H, W); 0: unknown."""
    names: Mapping[int, str]
    """Instance id -> label text."""
    things: frozenset[int]
    """Ids of the countable instances; the others are stuff."""

    def __post_init__(self) -> None:
        check_array("ground-truth instance image", self.instance, dtype=np.int32, shape=(None, None))


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One posed RGB-D image; colour and depth share size and intrinsics."""

    index: int
    """Position in the sequence."""
    stamp: float
    """Seconds."""
    color: npt.NDArray[np.uint8]
    """(H, W, 3), RGB."""
    depth: npt.NDArray[np.float32]
    """(H, W), metres along the optical axis; 0: invalid."""
    T_map_camera: npt.NDArray[np.float64]
    """(4, 4)."""
    intrinsics: Intrinsics
    truth: GroundTruth | None = None

    def __post_init__(self) -> None:
        shape = (self.intrinsics.height, self.intrinsics.width)
        check_array(f"frame {self.index}: colour", self.color, dtype=np.uint8, shape=(*shape, 3))
        check_array(f"frame {self.index}: depth", self.depth, dtype=np.float32, shape=shape)
        check_pose(f"frame {self.index}: T_map_camera", self.T_map_camera)


class Provenance(str, Enum):
    """Where a label came from (method.md section 1)."""

    CAPTION = "caption"
    TAG = "tag"
    DETECTOR = "detector"
    STRUCTURE = "structure"
    GROUND_TRUTH = "groundtruth"
    PRECOMPUTED = "precomputed"
    HAND = "hand"


@dataclass(frozen=True, kw_only=True)
class Label:
    """One open-vocabulary label, lemmatised."""

    text: str
    provenance: Provenance


@dataclass(frozen=True, kw_only=True, eq=False)
class Detections:
    """N boxes of one image."""

    boxes: npt.NDArray[np.float32]
    """(N, 4): x0, y0, x1, y1 in pixels."""
    scores: npt.NDArray[np.float32]
    """(N,), 0 to 1."""
    labels: tuple[Label, ...]

    def __post_init__(self) -> None:
        check_array("detection boxes", self.boxes, dtype=np.float32, shape=(len(self.labels), 4))
        check_array("detection scores", self.scores, dtype=np.float32, shape=(len(self.labels),))


@dataclass(frozen=True, kw_only=True)
class Category:
    """One unified category: a row of the COCO-Stuff table with its size prior."""

    id: int
    name: str
    supercategory: str
    is_thing: bool
    voxel_size: float
    """Size prior, metres."""


@dataclass(frozen=True, kw_only=True)
class ElementaryDescriptor:
    """e = <label, category, voxel size> of one segment (paper section 3.2.2)."""

    label: str
    category: Category
    provenance: Provenance
    score: float
    """The detector's confidence, 0 to 1."""
    feature: npt.NDArray[np.float32] | None = field(default=None, compare=False, repr=False)
    """(D,) unit vector of how it looks, where there is one."""

    @property
    def voxel_size(self) -> float:
        """Size prior inherited from the category, metres."""
        return self.category.voxel_size


@dataclass(frozen=True, kw_only=True)
class Segment:
    """One region of a frame before semantic retrieval."""

    label: Label
    score: float
    """0 to 1."""
    is_thing: bool
    """A countable object (one segment, one object) rather than a stretch of background."""
    feature: npt.NDArray[np.float32] | None = field(default=None, compare=False, repr=False)
    """(D,) unit vector of how it looks, where `perception.visual_feature` is set."""

    def __post_init__(self) -> None:
        check_range(f"score of segment {self.label.text!r}", self.score, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class PanopticSegmentation:
    """The segments of one frame as one id image."""

    ids: npt.NDArray[np.int32]
    """(H, W); 0: unlabeled, k: segments[k - 1]."""
    segments: tuple[Segment, ...]
    dropped: Mapping[str, int] = field(default_factory=dict[str, int])
    """Reason -> candidate segments dropped for it; `unlabeled_pixels` (valid, left at 0), `leaked_pixels`: pixels."""

    def __post_init__(self) -> None:
        check_array("segmentation ids", self.ids, dtype=np.int32, shape=(None, None))
        if self.ids.size:
            check_range("largest segmentation id", int(self.ids.max()), 0, len(self.segments))


@dataclass(frozen=True, kw_only=True, eq=False)
class DescribedSegmentation:
    """A segmentation whose segments have their elementary descriptors."""

    ids: npt.NDArray[np.int32]
    """(H, W); 0: unlabeled, k: descriptors[k - 1]."""
    descriptors: tuple[ElementaryDescriptor, ...]
    is_thing: tuple[bool, ...]


class SubmapKind(str, Enum):
    OBJECT = "object"
    BACKGROUND = "background"
    FREESPACE = "freespace"


class SubmapState(str, Enum):
    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    INACTIVE = "inactive"


@dataclass(frozen=True, kw_only=True)
class LabelRecord:
    """All that was said with one label text about one submap."""

    text: str
    category: int
    """Unified category id that the text was retrieved to."""
    count: int
    """Observations."""
    weight: float
    """Sum of the observations' vote weights."""
    provenance: tuple[Provenance, ...]
    first_frame: int
    last_frame: int


@dataclass(frozen=True, kw_only=True)
class DynamicDescriptor:
    """d = <labels with counts, unified category, size prior> of one submap (paper section 3.3)."""

    labels: tuple[LabelRecord, ...]
    """Most counted first."""
    category: Category
    confidence: float
    """Share of the vote weight that the category holds, 0 to 1."""
    feature: VisualFeature | None = field(default=None, compare=False, repr=False)
    """Where `perception.visual_feature` is set."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Submap:
    """One object, piece of background or freespace: everything but its voxels."""

    id: int
    """Unique in the map, from 1, never used again."""
    kind: SubmapKind
    state: SubmapState
    descriptor: DynamicDescriptor | None
    """None for freespace."""
    voxel_size: float
    """Metres."""
    truncation: float
    """Metres."""
    T_map_submap: npt.NDArray[np.float64]
    """(4, 4)."""
    first_frame: int
    last_frame: int
    views: int
    """Frames in which an observation was associated."""
    misses: int
    """Frames in which it should have been seen and was not, since the last view."""
    evidence: float
    """Accumulated detection score less negative evidence."""
    companions: tuple[tuple[int, int], ...] = ()
    """(id, frames) of younger submaps: frames in which one segment covered both, less those that had one for each."""
    apart: int = 0
    """Frames in which two segments fell on separate parts of it, less those in which one covered both."""
    parts: npt.NDArray[np.int32] | None = None
    """(N, 4), sorted: cells x, y, z of 2 voxels, and frames that saw each on the one part less those on the other."""
    bounds: npt.NDArray[np.float64]
    """(2, 3): lowest and highest corner of the observed surface in frame map; NaN where there is none."""

    @property
    def center(self) -> npt.NDArray[np.float64]:
        """(3,) centre of the bounds, frame map, metres."""
        return self.bounds.mean(axis=0)

    @property
    def extent(self) -> npt.NDArray[np.float64]:
        """(3,) size of the bounds along the map's axes, metres."""
        return self.bounds[1] - self.bounds[0]


class ChangeState(str, Enum):
    """What became of an object between two visits."""

    PERSISTENT = "persistent"
    ABSENT = "absent"
    NEW = "new"
    MOVED = "moved"
    UNOBSERVED = "unobserved"


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    """One object of either visit, and what became of it (docs/change-detection.md)."""

    state: ChangeState
    id_old: int | None
    """Submap in the old map; None for what is new."""
    id_new: int | None
    """Submap in the new map; None for what is absent or was not observed."""
    category: str
    label: str
    center_old: npt.NDArray[np.float64] | None
    """(3,) metres, frame of the new map, as is the next."""
    center_new: npt.NDArray[np.float64] | None
    evidence: Mapping[str, float]
    """What was counted: surface points by what speaks for and against them, and the likeness of a moved pair."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VoxelBlocks:
    """Voxels of one submap; N blocks of 8x8x8, axes (x, y, z), in frame submap.

    Voxel (i, j, k) of block b is centred at ((8 * coords[b] + (i, j, k)) + 0.5) * voxel_size.
    """

    coords: npt.NDArray[np.int32]
    """(N, 3), in blocks; sorted lexicographically."""
    distance: npt.NDArray[np.int16]
    """(N, 8, 8, 8): signed distance / truncation * 32767; positive in front of the surface."""
    weight: npt.NDArray[np.float32]
    """(N, 8, 8, 8); 0: never observed."""
    color: npt.NDArray[np.uint8]
    """(N, 8, 8, 8, 3), RGB."""
    belonging: npt.NDArray[np.uint8]
    """(N, 8, 8, 8, 2): times that the surface seen was this submap's, and another's; it belongs where [0] >= [1]."""

    def __post_init__(self) -> None:
        n, s = len(self.coords), VOXELS_PER_SIDE
        check_array("block coords", self.coords, dtype=np.int32, shape=(n, 3))
        check_array("block distance", self.distance, dtype=np.int16, shape=(n, s, s, s))
        check_array("block weight", self.weight, dtype=np.float32, shape=(n, s, s, s))
        check_array("block colour", self.color, dtype=np.uint8, shape=(n, s, s, s, 3))
        check_array("block belonging", self.belonging, dtype=np.uint8, shape=(n, s, s, s, 2))

    def __len__(self) -> int:
        return len(self.coords)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Triangles with a colour a vertex, frame map."""

    vertices: npt.NDArray[np.float32]
    """(V, 3), metres."""
    normals: npt.NDArray[np.float32]
    """(V, 3), unit length, out of the surface."""
    colors: npt.NDArray[np.uint8]
    """(V, 3), RGB."""
    faces: npt.NDArray[np.int32]
    """(F, 3), counter-clockwise seen from outside."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """What was done and what was left out, by reason; nothing is dropped without a count."""

    frames: int = 0
    """Frames integrated."""
    skipped: Mapping[str, int] = field(default_factory=dict[str, int])
    """Reason -> frames not integrated."""
    dropped: Mapping[str, int] = field(default_factory=dict[str, int])
    """Reason -> segments, submaps or pixels dropped."""
    seconds: Mapping[str, float] = field(default_factory=dict[str, float])
    """Stage -> seconds in total."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameRecord:
    """One frame that was integrated or skipped."""

    index: int
    stamp: float
    T_map_camera: npt.NDArray[np.float64] | None
    """(4, 4); None where the frame could not be read."""
    skipped: str | None = None
    """Reason, where it was not integrated."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Checkpoint:
    """What changed in a map since the last checkpoint: one transaction of the map file."""

    submaps: tuple[Submap, ...]
    """All that exist now; any other submap in the file is deleted with its blocks."""
    changed: Mapping[int, VoxelBlocks]
    """Submap id -> blocks that are new or were written."""
    pruned: Mapping[int, npt.NDArray[np.int32]]
    """Submap id -> coords (N, 3) of blocks that are gone."""
    merged: Mapping[int, int] = field(default_factory=dict[int, int])
    """Submap that was merged away -> the one that it became part of."""
    next_id: int
    """The id that the next submap will get."""
    frames: tuple[FrameRecord, ...]
    """Frames since the last checkpoint."""
    label_embeddings: Mapping[str, npt.NDArray[np.float32]]
    """Label text -> unit vector (D,), new since the last checkpoint."""
    report: Report
    """Totals from the start."""
