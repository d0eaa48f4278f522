"""All submaps of a running fusion with their voxels: what is done to one or two of them at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.core.geometry import transform
from uppm.core.protocols import VoxelSource
from uppm.core.types import Submap, SubmapKind, SubmapState, VoxelBlocks
from uppm.fusion import merging, splitting
from uppm.fusion.resampling import resample
from uppm.fusion.submaps import LiveSubmap
from uppm.fusion.volume import MESHED, Volume


class SubmapCollection:
    """The submaps by id, in the order in which they came.

    Parameters
    ----------
    volume : Volume
        Holds their voxels.
    truncation : float
        Truncation distance, voxels.
    """

    def __init__(self, volume: Volume, truncation: float) -> None:
        self._volume, self._truncation = volume, truncation
        self._submaps: dict[int, LiveSubmap] = {}
        self._by_slot: dict[int, LiveSubmap] = {}
        self._slots: npt.NDArray[np.int32] | None = None
        self._bounds: dict[int, npt.NDArray[np.float64]] = {}
        self.freespace: LiveSubmap | None = None
        self.rest: LiveSubmap | None = None
        """The background that no segment covers."""
        self.next_id = 1
        self.dropped: Counter[str] = Counter()
        """Reason -> segments and submaps dropped so far."""
        self.merged: dict[int, int] = {}
        """Submap that was merged away -> the one that it became part of."""

    def __iter__(self) -> Iterator[LiveSubmap]:
        return iter(self._submaps.values())

    def __contains__(self, submap_id: int) -> bool:
        return submap_id in self._submaps

    def get(self, submap_id: int) -> LiveSubmap | None:
        """The submap, or None where it has been merged or removed."""
        return self._submaps.get(submap_id)

    def by_id(self) -> Mapping[int, LiveSubmap]:
        """All submaps."""
        return self._submaps

    def slots(self) -> npt.NDArray[np.int32]:
        """Slots (S,) of all submaps, in their order."""
        if self._slots is None:
            self._slots = np.fromiter((s.slot for s in self), dtype=np.int32, count=len(self._submaps))
        return self._slots

    def at(self, slots: npt.NDArray[np.int32]) -> list[LiveSubmap]:
        """The submaps at these slots, in the order in which they came."""
        return sorted((self._by_slot[slot] for slot in slots.tolist()), key=lambda s: s.id)

    def _enter(self, submap: LiveSubmap) -> None:
        self._submaps[submap.id] = self._by_slot[submap.slot] = submap
        self._slots = None

    def _leave(self, submap: LiveSubmap) -> None:
        del self._submaps[submap.id], self._by_slot[submap.slot]
        self._bounds.pop(submap.id, None)
        self._slots = None

    def add(self, kind: SubmapKind, voxel_size: float, frame: int) -> LiveSubmap:
        """A new tentative submap without voxels; voxel_size in metres."""
        truncation = voxel_size * self._truncation
        slot = self._volume.add(voxel_size, truncation, np.eye(4), kind is SubmapKind.FREESPACE)
        submap = LiveSubmap(
            id=self.next_id,
            slot=slot,
            kind=kind,
            state=SubmapState.TENTATIVE,
            descriptor=None,
            voxel_size=voxel_size,
            truncation=truncation,
            first_frame=frame,
            last_frame=frame,
        )
        self._enter(submap)
        self.next_id += 1
        return submap

    def remove(self, submap_id: int, reason: str) -> None:
        """Remove a submap with its voxels, and count why."""
        self.dropped[reason] += 1
        submap = self._submaps[submap_id]
        self._leave(submap)
        self._volume.remove(submap.slot)

    def unlabel(self, submap: LiveSubmap, voxel_size: float, reason: str) -> None:
        """Give a submap's surface to the background that no segment covers; what it was called is forgotten.

        voxel_size: that background's, metres, should this be its first surface.
        """
        self.dropped[reason] += 1
        submap.kind, submap.descriptor, submap.views, submap.evidence = SubmapKind.BACKGROUND, None, 0, 0.0
        if self.rest is None:
            self.rest, submap.state = submap, SubmapState.CONFIRMED
            self.resize(submap, voxel_size)
        else:
            self._become_part(submap, self.rest)

    def resize(self, submap: LiveSubmap, voxel_size: float) -> None:
        """Resample a submap to another voxel size, metres."""
        truncation = voxel_size * self._truncation
        blocks = self._volume.gather(self._volume.indices(submap.slot))
        moved = resample(blocks, submap.voxel_size, submap.truncation, voxel_size, truncation)
        self._volume.replace(submap.slot, voxel_size, truncation, moved)
        submap.voxel_size, submap.truncation = voxel_size, truncation
        submap.forget_parts()

    def merge(self, kept: LiveSubmap, other: LiveSubmap) -> LiveSubmap:
        """Make two submaps one; returns the kept one."""
        self._become_part(other, kept)
        self.dropped["duplicate submap merged"] += 1
        return kept

    def _become_part(self, other: LiveSubmap, kept: LiveSubmap) -> None:
        merging.merge(kept, other, self._volume)
        self._leave(other)
        merging.inherit(kept, other, self)
        self.merged[other.id] = kept.id
        self._bounds.pop(kept.id, None)

    def divide(self, submap: LiveSubmap, frame: int) -> None:
        """Make a submap's lesser part a submap of its own; what was said of the whole was said of both."""
        new = self._part(submap, frame, None)
        new.state, new.descriptor, new.evidence = submap.state, submap.descriptor, submap.evidence
        new.first_frame, new.views = submap.first_frame, submap.apart
        merging.count_together(submap, new, -submap.apart)
        submap.forget_parts()

    def cede(self, submap: LiveSubmap, side: int, other: LiveSubmap, frame: int) -> None:
        """Give the part on one side of a submap to another submap, which was seen there."""
        part = self._part(submap, frame, side)
        part.state = other.state
        merging.merge(other, part, self._volume)
        self._leave(part)
        self._bounds.pop(other.id, None)
        submap.forget_parts()

    def _part(self, submap: LiveSubmap, frame: int, side: int | None) -> LiveSubmap:
        """A new submap with the voxels of a part."""
        kept, part = splitting.divide(submap, self._volume.gather(self._volume.indices(submap.slot)), side)
        new = self.add(submap.kind, submap.voxel_size, frame)
        new.T_map_submap = submap.T_map_submap.copy()
        self._volume.set_pose(new.slot, new.T_map_submap)
        self._volume.replace(submap.slot, submap.voxel_size, submap.truncation, kept)
        self._volume.put(new.slot, part)
        self._bounds.pop(submap.id, None)
        return new

    def move(self, corrections: Mapping[int, npt.NDArray[np.float64]]) -> None:
        """Move submaps with the frames that saw them, without fusing anything again.

        corrections: frame index -> (4, 4) that takes a point from where that frame put it to where it belongs. A submap
        moves with the corrected frame nearest to the middle of its first and last.
        """
        frames = np.array(sorted(corrections))
        for submap in self:
            nearest = frames[np.abs(frames - (submap.first_frame + submap.last_frame) / 2).argmin()]
            submap.T_map_submap = corrections[int(nearest)] @ submap.T_map_submap
            self._volume.set_pose(submap.slot, submap.T_map_submap)
        self._bounds.clear()

    def changed(self, blocks: npt.NDArray[np.int32]) -> None:
        """These blocks of the pool were written: bounds of their submaps are to be found again."""
        for slot in np.unique(self._volume.pool.block_slot[blocks]).tolist():
            self._bounds.pop(self._by_slot[slot].id, None)

    def forget_bounds(self) -> None:
        """All bounds are to be found again."""
        self._bounds.clear()

    def bounds(self, submap: LiveSubmap) -> npt.NDArray[np.float64]:
        """Lowest and highest corner (2, 3) of a submap's surface, frame map; NaN where it has none."""
        if submap.id not in self._bounds:
            points = transform(submap.T_map_submap, self._volume.surface_points(submap.slot))
            nothing = np.full((2, 3), np.nan)
            self._bounds[submap.id] = np.stack([points.min(0), points.max(0)]) if len(points) else nothing
        return self._bounds[submap.id]

    def near(self, submap: LiveSubmap, others: Sequence[LiveSubmap]) -> list[LiveSubmap]:
        """Those whose bounds meet the submap's."""
        low, high = self.bounds(submap)
        bounds = [self.bounds(s) for s in others]
        return [s for s, (a, b) in zip(others, bounds, strict=True) if (a <= high).all() and (low <= b).all()]

    def records(self) -> tuple[Submap, ...]:
        """Records of all submaps, by id."""
        return tuple(s.record(self.bounds(s)) for _, s in sorted(self._submaps.items()))

    def blocks(self, submap_id: int) -> VoxelBlocks:
        """Copies of a submap's voxels; raises `InputError` where it has been merged or removed."""
        if submap_id not in self._submaps:
            found, advice = "one that was merged or removed since", "ask the mapper for its map again"
            raise InputError(f"submap {submap_id}", expected="a submap of the running map", found=found, advice=advice)
        return self._volume.gather(self._volume.indices(self._submaps[submap_id].slot))

    def touched(self, submap_id: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """Coordinates of a submap's blocks, (N, 3), and of those written since the last call, (M, 3)."""
        slot, coords = self._submaps[submap_id].slot, self._volume.pool.block_coord
        return coords[self._volume.indices(slot)], coords[self._volume.take_written(slot, MESHED)]

    def blocks_at(self, submap_id: int, coords: npt.NDArray[np.int32]) -> VoxelBlocks:
        """Copies of the blocks at some coordinates, (N, 3), all of which exist, sorted."""
        return self._volume.gather(self._volume.find(self._submaps[submap_id].slot, coords))

    def changes(self) -> tuple[dict[int, VoxelBlocks], dict[int, npt.NDArray[np.int32]]]:
        """Blocks written, and coordinates pruned, since the last call, by submap id."""
        changed: dict[int, VoxelBlocks] = {}
        pruned: dict[int, npt.NDArray[np.int32]] = {}
        for submap in self:
            blocks, gone = self._volume.changes(submap.slot)
            if len(blocks):
                changed[submap.id] = blocks
            if len(gone):
                pruned[submap.id] = gone
        return changed, pruned

    def restore(self, submaps: Iterable[Submap], source: VoxelSource, next_id: int) -> None:
        """Go on from the records and voxels of a saved map; the collection must be new."""
        for record in submaps:
            freespace = record.kind is SubmapKind.FREESPACE
            slot = self._volume.add(record.voxel_size, record.truncation, record.T_map_submap, freespace)
            self._enter(LiveSubmap.of(record, slot))
            self._volume.put(slot, source.blocks(record.id))
            if freespace:
                self.freespace = self._submaps[record.id]
            elif record.descriptor is None:
                self.rest = self._submaps[record.id]
        self.changes()
        self.next_id = next_id
