"""The submaps of a running fusion: what changes from frame to frame, and its frozen record."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from uppm.core.types import DynamicDescriptor, Submap, SubmapKind, SubmapState


def no_parts() -> npt.NDArray[np.int32]:
    """Cells (N, 4) of a submap that was never seen as two objects, as `Submap.parts`."""
    return np.empty((0, 4), dtype=np.int32)


@dataclass(kw_only=True, eq=False)
class LiveSubmap:
    """A submap while it is mapped; fields as in `uppm.core.types.Submap`, plus its slot in the volume."""

    id: int
    slot: int
    kind: SubmapKind
    state: SubmapState
    descriptor: DynamicDescriptor | None
    voxel_size: float
    truncation: float
    first_frame: int
    last_frame: int
    views: int = 0
    misses: int = 0
    evidence: float = 0.0
    companions: dict[int, int] = field(default_factory=dict)
    apart: int = 0
    parts: npt.NDArray[np.int32] = field(default_factory=no_parts)
    T_map_submap: npt.NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    @property
    def category_id(self) -> int:
        """Unified category; 0 for freespace, which has none."""
        return self.descriptor.category.id if self.descriptor else 0

    def forget_parts(self) -> None:
        """Begin anew to look for two objects in it."""
        self.apart, self.parts = 0, no_parts()

    def record(self, bounds: npt.NDArray[np.float64]) -> Submap:
        """Its state now, with the bounds (2, 3) of its surface in frame map."""
        return Submap(
            id=self.id,
            kind=self.kind,
            state=self.state,
            descriptor=self.descriptor,
            voxel_size=self.voxel_size,
            truncation=self.truncation,
            T_map_submap=self.T_map_submap.copy(),
            first_frame=self.first_frame,
            last_frame=self.last_frame,
            views=self.views,
            misses=self.misses,
            evidence=self.evidence,
            companions=tuple(sorted(self.companions.items())),
            apart=self.apart,
            parts=self.parts if self.apart else None,
            bounds=bounds,
        )

    @classmethod
    def of(cls, record: Submap, slot: int) -> LiveSubmap:
        """The submap of a record, to go on from it."""
        return cls(
            id=record.id,
            slot=slot,
            kind=record.kind,
            state=record.state,
            descriptor=record.descriptor,
            voxel_size=record.voxel_size,
            truncation=record.truncation,
            first_frame=record.first_frame,
            last_frame=record.last_frame,
            views=record.views,
            misses=record.misses,
            evidence=record.evidence,
            companions=dict(record.companions),
            apart=record.apart,
            parts=no_parts() if record.parts is None else record.parts,
            T_map_submap=record.T_map_submap.copy(),
        )
