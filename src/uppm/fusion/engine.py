"""Unified panoptic fusion: one frame and its described segments into the multi-resolution multi-TSDF map."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from numba.core import config as numba_config

from uppm._kernels.hashing import NONE
from uppm.core.config import FusionConfig
from uppm.core.errors import InputError
from uppm.core.geometry import transform
from uppm.core.protocols import VoxelSource
from uppm.core.types import (
    DescribedSegmentation,
    Frame,
    Submap,
    SubmapKind,
    SubmapState,
    VoxelBlocks,
)
from uppm.fusion import descriptors, lifecycle, merging, tracking
from uppm.fusion.cleaning import stray_parts
from uppm.fusion.resampling import resample
from uppm.fusion.submaps import LiveSubmap
from uppm.fusion.view import View, ViewFactory
from uppm.fusion.volume import Visible, Volume

FloatImage = npt.NDArray[np.float32]
IdImage = npt.NDArray[np.int32]


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """The submaps that a frame may show, and how its segments fall on them."""

    submaps: tuple[LiveSubmap, ...]
    visible: Visible
    overlap: npt.NDArray[np.int64]
    """(submaps, segments + 1), pixels; column 0: unlabeled."""
    observed: npt.NDArray[np.int64]
    """(segments,), pixels with valid depth."""
    depth: npt.NDArray[np.float64]
    """(segments,), mean depth, metres."""
    least: npt.NDArray[np.float64]
    """(submaps, segments), IoU asked for by the two categories; inf where they do not go together."""


class PanopticFusion:
    """Holds the submaps and their volume, and fuses frames into them.

    Parameters
    ----------
    config : FusionConfig
    similarity : (C, C) float32
        Cosine of the embeddings of each two unified categories, in the order of the category table.
    """

    def __init__(self, config: FusionConfig, similarity: npt.NDArray[np.float32]) -> None:
        self._config = config
        self._policy = tracking.CategoryPolicy(config.category_policy, config.min_cosine, similarity)
        self._threads = min(config.threads, numba_config.NUMBA_NUM_THREADS)  # pyright: ignore[reportAttributeAccessIssue]
        self._views = ViewFactory(config.depth_min, config.depth_max, along_normal=config.distance == "normal")
        self._volume = Volume(config.max_blocks, config.max_weight, config.interpolation_max_step)
        self._submaps: dict[int, LiveSubmap] = {}
        self._bounds: dict[int, npt.NDArray[np.float64]] = {}
        self._freespace: LiveSubmap | None = None
        self._rest: LiveSubmap | None = None
        self.next_id = 1
        self.dropped: Counter[str] = Counter()
        """Reason -> segments and submaps dropped so far."""

    def fuse(self, frame: Frame, segmentation: DescribedSegmentation) -> IdImage:
        """Fuse one frame. Returns the submap id of each pixel, (H, W), 0 where there is none."""
        numba.set_num_threads(self._threads)
        view = self._views.view(frame)
        self._found_common(frame.index, bool(((segmentation.ids == 0) & (view.depth > 0)).any()))
        tracks = self._track(view, segmentation)
        targets = self._associate(tracks)  # paper equation 4
        submaps = self._observe(frame, tracks, targets, segmentation)
        self._miss(view, tracks, submaps)
        ids = self._integrate(view, tracks, submaps, segmentation.ids)
        self._merge_companions(tracks, targets)
        return ids

    def _found_common(self, frame: int, unlabeled: bool) -> None:
        """The two submaps that are no segment's: freespace, and the background that no segment covers."""
        if self._freespace is None:
            self._freespace = self._add(SubmapKind.FREESPACE, self._config.freespace_voxel_size, frame)
        if self._rest is None and unlabeled:
            self._rest = self._add(SubmapKind.BACKGROUND, self._config.unlabeled_voxel_size, frame)
        for submap in (self._freespace, self._rest):
            if submap:
                submap.state, submap.last_frame, submap.views = SubmapState.CONFIRMED, frame, submap.views + 1

    def _add(self, kind: SubmapKind, voxel_size: float, frame: int) -> LiveSubmap:
        truncation = voxel_size * self._config.truncation
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
        self._submaps[submap.id] = submap
        self.next_id += 1
        return submap

    def _track(self, view: View, segmentation: DescribedSegmentation) -> Tracks:
        """Render the submaps in view."""
        slots = np.array([s.slot for s in self._submaps.values()], dtype=np.int32)
        visible = self._volume.visible(view, slots)
        in_view = set(np.unique(self._volume.pool.block_slot[visible.blocks]).tolist())
        solid = tuple(s for s in self._submaps.values() if s.descriptor and s.slot in in_view)
        slots = np.array([s.slot for s in solid], dtype=np.int32)
        n = len(segmentation.descriptors)
        overlap, observed, depth = self._volume.overlap(view, visible, slots, segmentation.ids, n)
        least = self._policy.least_overlap(
            [s.category_id for s in solid], [d.category.id for d in segmentation.descriptors], self._config.min_iou
        )
        return Tracks(submaps=solid, visible=visible, overlap=overlap, observed=observed, depth=depth, least=least)

    def _associate(self, tracks: Tracks) -> npt.NDArray[np.intp]:
        """Row in `tracks.submaps` of each segment, or NEW (paper equation 4)."""
        c = self._config
        targets = tracking.assign(tracking.iou_matrix(tracks.overlap, tracks.observed), tracks.least)
        return tracking.join_contained(
            targets, tracks.overlap, tracks.observed, np.isfinite(tracks.least), c.min_containment
        )

    def _observe(
        self, frame: Frame, tracks: Tracks, targets: npt.NDArray[np.intp], segmentation: DescribedSegmentation
    ) -> list[LiveSubmap | None]:
        """Give each segment its submap, new ones included, and each submap its labels."""
        out: list[LiveSubmap | None] = []
        for n, e in enumerate(segmentation.descriptors):
            submap = tracks.submaps[targets[n]] if targets[n] != tracking.NEW else None
            size = self._config.voxel_size or e.voxel_size
            if submap is None and self._founds(frame, size, int(tracks.observed[n]), tracks.depth[n]):
                submap = self._add(SubmapKind.BACKGROUND, size, frame.index)
            out.append(submap)
            if submap is None:
                self.dropped["segment too small to found a submap"] += 1
                continue
            weight = lifecycle.vote_weight(e.score, float(tracks.depth[n]), self._config)
            if segmentation.is_thing[n]:
                submap.kind = SubmapKind.OBJECT
            submap.descriptor = descriptors.observe(submap.descriptor, e, frame.index, weight)
            lifecycle.seen(submap, frame.index, e.score, self._config)
            self._follow_size_prior(submap)
        return out

    def _founds(self, frame: Frame, voxel_size: float, pixels: int, depth: float) -> bool:
        k = frame.intrinsics
        return pixels >= lifecycle.min_pixels(voxel_size, depth, k.fx * k.fy, self._config)

    def _follow_size_prior(self, submap: LiveSubmap) -> None:
        """Resample a submap whose category has had another size prior for long enough not to flip back."""
        d = submap.descriptor
        if d is None or self._config.voxel_size or d.category.voxel_size == submap.voxel_size:
            return
        if d.confidence < self._config.resample_confidence or submap.views < self._config.resample_views:
            return
        size, truncation = d.category.voxel_size, d.category.voxel_size * self._config.truncation
        blocks = self._volume.gather(self._volume.indices(submap.slot))
        moved = resample(blocks, submap.voxel_size, submap.truncation, size, truncation)
        self._volume.replace(submap.slot, size, truncation, moved)
        submap.voxel_size, submap.truncation = size, truncation

    def _miss(self, view: View, tracks: Tracks, seen: Sequence[LiveSubmap | None]) -> None:
        """Negative evidence for objects that were in view and that no segment went to."""
        found = {s.id for s in seen if s}
        missing = [s for s in tracks.submaps if s.id not in found and s.kind is SubmapKind.OBJECT]
        if not missing:
            return
        slots = np.array([s.slot for s in missing], dtype=np.int32)
        blocks = tracks.visible.blocks
        blocks = blocks[np.isin(self._volume.pool.block_slot[blocks], slots)]
        counts = self._volume.expected(view, blocks, slots)
        for submap, (measured, through) in zip(missing, counts.tolist(), strict=True):
            if lifecycle.missed(submap, measured, through, self._config):
                self.dropped["tentative submap not seen again"] += 1
                self.remove(submap.id)

    def _merge_companions(self, tracks: Tracks, targets: npt.NDArray[np.intp]) -> None:
        """Merge submaps that one segment covered together often enough."""
        allowed = np.isfinite(tracks.least)
        for a, b in tracking.covered_together(targets, tracks.overlap, tracks.observed, allowed):
            pair = [self._submaps.get(tracks.submaps[row].id) for row in (a, b)]
            if pair[0] is None or pair[1] is None:
                continue
            kept, other = merging.older(pair[0], pair[1])
            kept.companions[other.id] = kept.companions.get(other.id, 0) + 1
            if kept.companions[other.id] >= self._config.merge_frames:
                self._merge(kept, other)

    def _merge(self, kept: LiveSubmap, other: LiveSubmap) -> None:
        merging.merge(kept, other, self._volume)
        del self._submaps[other.id]
        for submap_id in (kept.id, other.id):
            self._bounds.pop(submap_id, None)
        self.dropped["duplicate submap merged"] += 1

    def _integrate(self, view: View, tracks: Tracks, submaps: Sequence[LiveSubmap | None], ids: IdImage) -> IdImage:
        """Allocate and integrate; returns the submap id of each pixel."""
        rest = self._rest.slot if self._rest else NONE
        slots = np.array([rest, *(s.slot if s else rest for s in submaps)], dtype=np.int32)
        numbers = np.array([0, *(s.id if s else 0 for s in submaps)], dtype=np.int32)
        known = (*tracks.submaps, *(s for s in submaps if s), *([self._rest] if self._rest else []))
        active = sorted({s.slot for s in known if s.id in self._submaps and s.state is not SubmapState.INACTIVE})
        placed = self._volume.place(view, ids, slots, numbers, np.array(active, dtype=np.int32))
        # A removed or resampled submap's blocks may have been handed out again as new ones: each once.
        blocks = np.unique(np.concatenate([self._volume.to_update(tracks.visible, placed), placed.new]))
        seen = [s.slot for s in submaps if s and s.kind is SubmapKind.OBJECT]
        self._volume.integrate(view, blocks, placed.slot_image, rest, np.array(seen, dtype=np.int32))
        self._forget_bounds(blocks)
        return placed.id_image

    def _forget_bounds(self, blocks: npt.NDArray[np.int32]) -> None:
        changed = set(np.unique(self._volume.pool.block_slot[blocks]).tolist())
        for submap in self._submaps.values():
            if submap.slot in changed:
                self._bounds.pop(submap.id, None)

    def remove(self, submap_id: int) -> None:
        """Remove a submap with its voxels."""
        self._volume.remove(self._submaps.pop(submap_id).slot)
        self._bounds.pop(submap_id, None)

    def move(self, corrections: Mapping[int, npt.NDArray[np.float64]]) -> None:
        """Move submaps with the frames that saw them, without fusing anything again.

        corrections: frame index -> (4, 4) that takes a point from where that frame put it to where it belongs. A submap
        moves with the corrected frame nearest to the middle of its first and last.
        """
        frames = np.array(sorted(corrections))
        for submap in self._submaps.values():
            nearest = frames[np.abs(frames - (submap.first_frame + submap.last_frame) / 2).argmin()]
            submap.T_map_submap = corrections[int(nearest)] @ submap.T_map_submap
            self._volume.set_pose(submap.slot, submap.T_map_submap)
        self._bounds.clear()

    def finish(self) -> None:
        """End the session: drop what was never confirmed or lost its surface, merge duplicates, return empty blocks."""
        for submap in list(self._submaps.values()):
            if submap.descriptor and not lifecycle.believed(submap, self._config):
                self.dropped["submap with too little evidence at the end"] += 1
                self.remove(submap.id)
        self._drop_stray_parts()
        self._yield_unlabeled()
        for kept, other in merging.find_duplicates(self._submaps, self._volume, self._policy, self._config):
            self._merge(kept, other)
        for submap in list(self._submaps.values()):
            if submap.kind is SubmapKind.FREESPACE:
                continue
            if submap.descriptor and len(self._volume.surface_points(submap.slot)) < self._config.min_surface:
                self.dropped["submap without a surface of its own"] += 1
                self.remove(submap.id)
            else:
                self._volume.prune(submap.slot)
        self._bounds.clear()

    def _drop_stray_parts(self) -> None:
        for submap in self._submaps.values():
            voxels = self._volume.surface_voxels(submap.slot)
            if submap.kind is SubmapKind.OBJECT and len(voxels):
                stray = stray_parts(voxels[:, :3], voxels[:, 3], submap.voxel_size)
                self._volume.disown(submap.slot, transform(submap.T_map_submap, voxels[stray, :3]))

    def _yield_unlabeled(self) -> None:
        """What was labeled in some frames only is no part of the unlabeled background."""
        if self._rest is None:
            return
        for submap in self._submaps.values():
            if submap.descriptor:
                points = transform(submap.T_map_submap, self._volume.surface_points(submap.slot))
                self._volume.disown(self._rest.slot, points)

    def submaps(self) -> tuple[Submap, ...]:
        """Records of all submaps, by id."""
        return tuple(s.record(self._bounds_of(s)) for _, s in sorted(self._submaps.items()))

    def _bounds_of(self, submap: LiveSubmap) -> npt.NDArray[np.float64]:
        if submap.id not in self._bounds:
            points = transform(submap.T_map_submap, self._volume.surface_points(submap.slot))
            nothing = np.full((2, 3), np.nan)
            self._bounds[submap.id] = np.stack([points.min(0), points.max(0)]) if len(points) else nothing
        return self._bounds[submap.id]

    def blocks(self, submap_id: int) -> VoxelBlocks:
        """Copies of a submap's voxels; raises `InputError` where it has been merged or removed."""
        if submap_id not in self._submaps:
            found, advice = "one that was merged or removed since", "ask the mapper for its map again"
            raise InputError(f"submap {submap_id}", expected="a submap of the running map", found=found, advice=advice)
        return self._volume.gather(self._volume.indices(self._submaps[submap_id].slot))

    def changes(self) -> tuple[dict[int, VoxelBlocks], dict[int, npt.NDArray[np.int32]]]:
        """Blocks written, and coordinates pruned, since the last call, by submap id."""
        changed: dict[int, VoxelBlocks] = {}
        pruned: dict[int, npt.NDArray[np.int32]] = {}
        for submap in self._submaps.values():
            blocks, gone = self._volume.changes(submap.slot)
            if len(blocks):
                changed[submap.id] = blocks
            if len(gone):
                pruned[submap.id] = gone
        return changed, pruned

    def restore(self, submaps: Iterable[Submap], source: VoxelSource, next_id: int) -> None:
        """Go on from the records and voxels of a saved map; the fusion must be new."""
        for record in submaps:
            freespace = record.kind is SubmapKind.FREESPACE
            slot = self._volume.add(record.voxel_size, record.truncation, record.T_map_submap, freespace)
            self._submaps[record.id] = LiveSubmap.of(record, slot)
            self._volume.put(slot, source.blocks(record.id))
            if freespace:
                self._freespace = self._submaps[record.id]
            elif record.descriptor is None:
                self._rest = self._submaps[record.id]
        self.changes()
        self.next_id = next_id
