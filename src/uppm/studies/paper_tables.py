"""The paper's ablation tables: their rows and columns, which settings stand for a row, and the paper's own figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

VARIANTS: Mapping[str, tuple[str, ...]] = {
    "uppm": ("perception.use_tags=false",),
    "uppm, tags": ("perception.use_tags=true",),
    "ppm": ("perception.use_tags=false", "retrieval.method=labels", "fusion.category_policy=same"),
    "ppm, tags": ("perception.use_tags=true", "retrieval.method=labels", "fusion.category_policy=same"),
    "uppm, classic NMS": ("perception.use_tags=false", "perception.nms=classic"),
    "uppm, no NMS": ("perception.use_tags=false", "perception.nms=none"),
    "ppm, classic NMS": (
        "perception.use_tags=false",
        "retrieval.method=labels",
        "fusion.category_policy=same",
        "perception.nms=classic",
    ),
    "ppm, no NMS": (
        "perception.use_tags=false",
        "retrieval.method=labels",
        "fusion.category_policy=same",
        "perception.nms=none",
    ),
    "uppm, blurry frames": ("perception.use_tags=false", "perception.skip_blurry=false"),
    "uppm, same category": ("perception.use_tags=false", "fusion.category_policy=same"),
    "uppm, any category": ("perception.use_tags=false", "fusion.category_policy=any"),
    "uppm, one size": ("perception.use_tags=false", "fusion.voxel_size=0.03"),
    "uppm, majority": ("perception.use_tags=false", "fusion.votes=count"),
}
"""Name -> settings beside those given."""


@dataclass(frozen=True)
class Column:
    """A column of a table, and the metric that it shows."""

    title: str
    key: str
    scale: float = 1.0
    digits: int = 2


@dataclass(frozen=True)
class Row:
    """A row of a table: the figures of a variant, or what changes between two of them."""

    title: str
    variant: str
    paper: tuple[float, ...] = ()
    """The paper's figures, in the order of the columns; none where the paper has no such row."""
    against: str | None = None
    """The variant that this row is the change from: differences, or percent where the table says so."""


@dataclass(frozen=True)
class PaperTable:
    """One table of the paper's section on ablations, or one of ours."""

    title: str
    paper_data: str
    """What the paper's figures were measured on; empty where the paper has no such table."""
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    relative: frozenset[str] = field(default_factory=frozenset[str])
    """Columns whose change is in percent."""


COMPLETENESS = Column("Comp. [cm]", "completeness_cm")
ACCURACY = Column("Acc. [cm]", "accuracy_cm")
CHAMFER = Column("Chamf. [cm]", "chamfer_cm")
RATIO = Column("Comp. ratio [<5cm %]", "completion_ratio_5cm", 100)
QUALITY = (
    Column("PQ [%]", "pq", 100),
    Column("SQ [%]", "sq", 100),
    Column("RQ [%]", "rq", 100),
    Column("TP", "tp", digits=0),
    Column("FN", "fn", digits=0),
)
OURS = (
    COMPLETENESS,
    ACCURACY,
    CHAMFER,
    Column("PQ 3D [%]", "pq_3d", 100, 1),
    Column("objects / true", "object_count_ratio"),
    Column("recall of names [%]", "query_recall", 100, 1),
)

TABLES = (
    PaperTable(
        "Unified semantics and tags",
        "Flat, 762 frames",
        (COMPLETENESS, ACCURACY, CHAMFER),
        (
            Row("UPPM", "uppm", (1.1, 0.61, 2.64)),
            Row("UPPM with tags", "uppm, tags", (1.2, 0.63, 2.77)),
            Row("PPM", "ppm", (1.18, 0.65, 2.79)),
            Row("PPM with tags", "ppm, tags", (1.22, 0.66, 2.92)),
        ),
    ),
    PaperTable(
        "Non-maximum suppression: geometry",
        "Flat, 762 frames",
        (Column("Chamfer Dist. [cm]", "chamfer_cm"), RATIO),
        (
            Row("PPM", "ppm", (2.79, 70.38)),
            Row("PPM w/o NMS", "ppm, no NMS", (2.79, 62.11)),
            Row("PPM, classic NMS", "ppm, classic NMS"),
            Row("Enhancement", "ppm", (0.0, 8.27), against="ppm, no NMS"),
        ),
    ),
    PaperTable(
        "Non-maximum suppression: panoptic quality of the segments",
        "RIO, sequence 0cac7578",
        QUALITY,
        (
            Row("UPPM w/o NMS", "uppm, no NMS", (17.62, 75.16, 23.44, 283, 1669)),
            Row("UPPM (Ours)", "uppm", (28.82, 77.39, 37.23, 565, 1387)),
            Row("UPPM, classic NMS", "uppm, classic NMS"),
            Row("Improvement", "uppm", (63.5, 3.0, 58.8, 99.6, -16.9), against="uppm, no NMS"),
        ),
        relative=frozenset({"pq", "sq", "rq", "tp", "fn"}),
    ),
    PaperTable(
        "Blurry-frame filter",
        "RIO; the paper gives the change alone",
        (Column("Chamfer Dist. [cm]", "chamfer_cm"), RATIO, Column("frames skipped", "frames_skipped", digits=0)),
        (
            Row("without", "uppm, blurry frames"),
            Row("with", "uppm"),
            Row("Change", "uppm", (-16.675, 6.47), against="uppm, blurry frames"),
        ),
        relative=frozenset({"chamfer_cm"}),
    ),
    PaperTable(
        "Category policy, size priors, votes",
        "",
        OURS,
        (
            Row("UPPM: compatible, priors, weighted", "uppm"),
            Row("same category only", "uppm, same category"),
            Row("any category", "uppm, any category"),
            Row("one size, 3 cm", "uppm, one size"),
            Row("majority by count", "uppm, majority"),
            Row("PPM", "ppm"),
        ),
    ),
)
