"""Unified panoptic fusion: one frame and its described segments into the multi-resolution multi-TSDF map."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from numba.core import config as numba_config

from uppm._kernels.hashing import NONE
from uppm.core.config import FusionConfig
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
from uppm.fusion import descriptors, lifecycle, merging, splitting, tracking
from uppm.fusion.cleaning import seldom_seen, stray_parts
from uppm.fusion.collection import SubmapCollection
from uppm.fusion.submaps import LiveSubmap
from uppm.fusion.view import View, ViewFactory
from uppm.fusion.volume import Visible, Volume

IdImage = npt.NDArray[np.int32]


NOISE_GROWTH = {"constant": 0, "linear": 1, "quadratic": 2}
"""Power of the depth with which a sensor's noise grows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """The submaps that a frame may show, and how its segments fall on them."""

    submaps: tuple[LiveSubmap, ...]
    visible: Visible
    overlap: npt.NDArray[np.int64]
    """(submaps, segments + 1), pixels; column 0: unlabeled."""
    unlabeled: int
    """Pixels with valid depth that no segment covers."""
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
        certain = max(config.certain_iou, config.min_iou)
        self._policy = tracking.CategoryPolicy(config.category_policy, config.min_cosine, similarity, certain)
        self._threads = min(config.threads, numba_config.NUMBA_NUM_THREADS)  # pyright: ignore[reportAttributeAccessIssue]
        self._views = ViewFactory(config.depth_min, config.depth_max, along_normal=config.distance == "normal")
        max_step = config.interpolation_max_step if config.interpolation == "bilinear" else 0.0
        self._volume = Volume(config.max_blocks, config.max_weight, max_step, NOISE_GROWTH[config.noise])
        self._likeness = merging.Likeness(volume=self._volume, policy=self._policy, config=config)
        self._all = SubmapCollection(self._volume, config.truncation)
        self.dropped = self._all.dropped
        """Reason -> segments and submaps dropped so far."""

    def fuse(self, frame: Frame, segmentation: DescribedSegmentation) -> IdImage:
        """Fuse one frame. Returns the submap id of each pixel, (H, W), 0 where there is none."""
        numba.set_num_threads(self._threads)
        view = self._views.view(frame)
        tracks = self._track(view, segmentation)
        self._found_common(frame.index, tracks.unlabeled > 0)
        targets = self._associate(tracks)  # paper equation 4
        submaps = self._observe(frame, tracks, targets, segmentation)
        lost = self._miss(view, tracks, submaps)
        ids = self._integrate(view, tracks, submaps, segmentation.ids)
        self._merge_companions(tracks, targets)
        self._merge_deactivated(lost)
        self._split(frame, view, tracks, targets, submaps, segmentation.ids)
        return ids

    def carry(self, frame: Frame) -> IdImage:
        """Fuse a frame between keyframes: its segments are the map's submaps, rendered. Returns what `fuse` does.

        No labels are counted and nothing is missed: the frame brings geometry alone. What the map does not hold yet is
        unlabeled background, until a keyframe sees it.
        """
        numba.set_num_threads(self._threads)
        view = self._views.view(frame)
        nothing = np.zeros(view.depth.shape, dtype=np.int32)
        tracks = self._track(view, DescribedSegmentation(ids=nothing, descriptors=(), is_thing=()))
        slots = [s.slot for s in tracks.submaps if s.state is not SubmapState.INACTIVE]
        ids = self._volume.rendered(view, tracks.visible, np.array(slots, dtype=np.int32))
        self._found_common(frame.index, bool(((ids == 0) & (view.depth > 0)).any()))
        shown = set((np.unique(ids) - 1).tolist())
        by_slot = {s.slot: s for s in tracks.submaps}
        return self._integrate(view, tracks, [by_slot[s] if n in shown else None for n, s in enumerate(slots)], ids)

    def _found_common(self, frame: int, unlabeled: bool) -> None:
        """The two submaps that are no segment's: freespace, and the background that no segment covers."""
        if self._all.freespace is None:
            self._all.freespace = self._all.add(SubmapKind.FREESPACE, self._config.freespace_voxel_size, frame)
        if self._all.rest is None and unlabeled:
            self._all.rest = self._all.add(SubmapKind.BACKGROUND, self._config.unlabeled_voxel_size, frame)
        for submap in (self._all.freespace, self._all.rest):
            if submap:
                submap.state, submap.last_frame, submap.views = SubmapState.CONFIRMED, frame, submap.views + 1

    def _track(self, view: View, segmentation: DescribedSegmentation) -> Tracks:
        """Render the submaps in view."""
        visible = self._volume.visible(view, self._all.slots())
        in_view = self._all.at(np.unique(self._volume.pool.block_slot[visible.blocks]))
        solid = tuple(s for s in in_view if s.descriptor and self._tracked(s))
        slots = np.array([s.slot for s in solid], dtype=np.int32)
        n = len(segmentation.descriptors)
        overlap, pixels, depth = self._volume.overlap(view, visible, slots, segmentation.ids, n)
        least = self._policy.least_overlap(
            [s.category_id for s in solid], [d.category.id for d in segmentation.descriptors], self._config.min_iou
        )
        return Tracks(
            submaps=solid,
            visible=visible,
            overlap=overlap,
            unlabeled=int(pixels[0]),
            observed=pixels[1:],
            depth=depth[1:],
            least=least,
        )

    def _tracked(self, submap: LiveSubmap) -> bool:
        return self._config.track_inactive or submap.state is not SubmapState.INACTIVE

    def _associate(self, tracks: Tracks) -> npt.NDArray[np.intp]:
        """Row in `tracks.submaps` of each segment, or NEW (paper equation 4)."""
        c = self._config
        assign = tracking.assign if c.association == "optimal" else tracking.assign_greedily
        least = np.minimum(tracks.least, self._policy.certain_iou)
        targets = assign(tracking.iou_matrix(tracks.overlap, tracks.observed), least)
        if c.min_containment is None:
            return targets
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
                submap = self._all.add(SubmapKind.BACKGROUND, size, frame.index)
            out.append(submap)
            if submap is None:
                self.dropped["segment too small to found a submap"] += 1
                continue
            first = submap.descriptor is None
            weight = lifecycle.vote_weight(e.score, float(tracks.depth[n]), self._config, first=first)
            if segmentation.is_thing[n]:
                submap.kind = SubmapKind.OBJECT
            submap.descriptor = descriptors.observe(submap.descriptor, e, frame.index, weight)
            lifecycle.seen(submap, frame.index, e.score, self._config)
            self._follow_size_prior(submap)
        return out

    def _follow_size_prior(self, submap: LiveSubmap) -> None:
        """Resample a submap whose category has had another size prior for long enough not to flip back."""
        d, c = submap.descriptor, self._config
        if d is None or not c.resample or c.voxel_size or d.category.voxel_size == submap.voxel_size:
            return
        if d.confidence >= c.resample_confidence and submap.views >= c.resample_views:
            self._all.resize(submap, d.category.voxel_size)

    def _founds(self, frame: Frame, voxel_size: float, pixels: int, depth: float) -> bool:
        return pixels >= lifecycle.min_pixels(voxel_size, depth, frame.intrinsics, self._config)

    def _miss(self, view: View, tracks: Tracks, seen: Sequence[LiveSubmap | None]) -> list[LiveSubmap]:
        """Negative evidence for objects that were in view and that no segment went to; returns those now inactive."""
        found = {s.id for s in seen if s}
        counts = self._config.life_cycle == "count"
        missing = [s for s in (self._all if counts else tracks.submaps) if s.descriptor and s.id not in found]
        active = [s for s in missing if s.state is not SubmapState.INACTIVE]
        if counts:
            gone = [s for s in active if lifecycle.unseen(s, self._config)]
        else:
            gone = self._contradicted(view, tracks, [s for s in missing if s.kind is SubmapKind.OBJECT])
        for submap in gone:
            self._all.remove(submap.id, "tentative submap not seen again")
        return [s for s in active if s.state is SubmapState.INACTIVE]

    def _contradicted(self, view: View, tracks: Tracks, missing: Sequence[LiveSubmap]) -> list[LiveSubmap]:
        """Of the objects that are missing in this frame, those that are to be removed."""
        if not missing:
            return []
        slots = np.array([s.slot for s in missing], dtype=np.int32)
        blocks = tracks.visible.blocks
        blocks = blocks[np.isin(self._volume.pool.block_slot[blocks], slots)]
        counts = self._volume.expected(view, blocks, slots)
        pairs = zip(missing, counts.tolist(), strict=True)
        return [s for s, (measured, through) in pairs if lifecycle.missed(s, measured, through, self._config)]

    def _merge_companions(self, tracks: Tracks, targets: npt.NDArray[np.intp]) -> None:
        """Merge submaps that one segment covered together often enough, and count those that had one each."""
        if self._config.merge_frames is None:
            return
        allowed = np.isfinite(tracks.least)
        for a, b in tracking.seen_apart(targets, allowed):
            merging.count_together(tracks.submaps[a], tracks.submaps[b], -1)
        for a, b in tracking.covered_together(targets, tracks.overlap, tracks.observed, allowed):
            pair = [self._all.get(tracks.submaps[row].id) for row in (a, b)]
            if pair[0] is None or pair[1] is None:
                continue
            if merging.count_together(pair[0], pair[1], 1) >= self._config.merge_frames:
                self._all.merge(*merging.older(pair[0], pair[1]))

    def _merge_deactivated(self, lost: Sequence[LiveSubmap]) -> None:
        """Merge submaps that became inactive with their duplicates, again and again."""
        which = self._config.merge_deactivated
        for one in lost if which != "none" else ():
            submap: LiveSubmap | None = one
            while submap and submap.id in self._all:
                others = [s for s in self._all if s.id != submap.id and s.descriptor]
                others = [s for s in others if which == "all" or s.state is SubmapState.INACTIVE]
                found = merging.find_duplicate(submap, self._all.near(submap, others), self._likeness)
                submap = self._all.merge(*merging.older(submap, found)) if found else None

    def _split(
        self,
        frame: Frame,
        view: View,
        tracks: Tracks,
        targets: npt.NDArray[np.intp],
        submaps: Sequence[LiveSubmap | None],
        ids: IdImage,
    ) -> None:
        """Split objects that were observed as two for long enough."""
        if self._config.split_frames is None:
            return
        for row, submap in enumerate(tracks.submaps):
            if submap.id not in self._all or submap.kind is not SubmapKind.OBJECT:
                continue
            segments = splitting.rivals(row, targets, tracks.overlap, tracks.observed)
            if len(segments) < 2 and not (segments and submap.apart):
                continue
            cells = [splitting.segment_cells(submap, view, ids, frame.T_map_camera, n + 1) for n in segments]
            if len(cells) == 2:
                splitting.seen_apart(submap, *cells)
            else:
                splitting.seen_as_one(submap, cells[0])
            if submap.apart < self._config.split_frames:
                continue
            others = [submaps[n] for n in segments if submaps[n] is not submap]
            if others and others[0] and others[0].id in self._all:
                self._all.cede(submap, splitting.side_of(submap, cells[1]), others[0], frame.index)
            else:
                self._all.divide(submap, frame.index)

    def _integrate(self, view: View, tracks: Tracks, submaps: Sequence[LiveSubmap | None], ids: IdImage) -> IdImage:
        """Allocate and integrate; returns the submap id of each pixel."""
        rest = self._all.rest.slot if self._all.rest else NONE
        slots = np.array([rest, *(s.slot if s else rest for s in submaps)], dtype=np.int32)
        numbers = np.array([0, *(s.id if s else 0 for s in submaps)], dtype=np.int32)
        active = self._active(tracks, submaps)
        placed = self._volume.place(view, ids, slots, numbers, active)
        if self._config.update == "surface":
            old = self._volume.to_update(tracks.visible, placed)
        else:
            free = [self._all.freespace.slot] if self._all.freespace else []
            old = tracks.visible.blocks
            old = old[np.isin(self._volume.pool.block_slot[old], [*active.tolist(), *free])]
        # A removed or resampled submap's blocks may have been handed out again as new ones: each once.
        blocks = np.unique(np.concatenate([old, placed.new]))
        seen = [s.slot for s in submaps if s and s.kind is SubmapKind.OBJECT]
        self._volume.integrate(view, blocks, placed.slot_image, rest, np.array(seen, dtype=np.int32))
        if self._config.belonging == "once":
            self._volume.pool.belonging[blocks, ..., 1] = 0
        self._all.changed(blocks)
        return placed.id_image

    def _active(self, tracks: Tracks, submaps: Sequence[LiveSubmap | None]) -> npt.NDArray[np.int32]:
        """Slots of the submaps to integrate the frame into, besides freespace."""
        in_view = () if self._config.update == "tracked" else tracks.submaps
        known = (*in_view, *(s for s in submaps if s), *([self._all.rest] if self._all.rest else []))
        active = {s.slot for s in known if s.id in self._all and s.state is not SubmapState.INACTIVE}
        return np.array(sorted(active), dtype=np.int32)

    def finish(self) -> None:
        """End the session: drop what was never confirmed or lost its surface, merge duplicates, return empty blocks."""
        for submap in [s for s in self._all if s.descriptor and not lifecycle.believed(s, self._config)]:
            reason = "submap with too little evidence at the end"
            if submap.state is SubmapState.TENTATIVE:
                # Seen too seldom for what it was called, but measured; a confirmed one lost its evidence by going away.
                self._all.unlabel(submap, self._config.unlabeled_voxel_size, reason)
            else:
                self._all.remove(submap.id, reason)
        if self._config.clean:
            self._drop_stray_parts()
        self._yield_unlabeled()
        for kept, other in merging.find_duplicates(self._all.by_id(), self._likeness):
            self._all.merge(kept, other)
        if self._config.clean:
            self._settle_contested()
        for submap in [s for s in self._all if s.kind is not SubmapKind.FREESPACE]:
            if submap.descriptor and len(self._volume.surface_points(submap.slot)) < self._config.min_surface:
                self._all.remove(submap.id, "submap without a surface of its own")
            else:
                self._volume.prune(submap.slot)
        self._all.forget_bounds()

    def _drop_stray_parts(self) -> None:
        for submap in self._all:
            voxels = self._volume.surface_voxels(submap.slot)
            if submap.kind is SubmapKind.OBJECT and len(voxels):
                stray = stray_parts(voxels[:, :3], voxels[:, 3], submap.voxel_size)
                self._volume.disown(submap.slot, transform(submap.T_map_submap, voxels[stray, :3]))

    def _settle_contested(self) -> None:
        """What a submap was seldom seen at, and another more often, is the other's: a mask leaked onto it."""
        labeled = [s for s in self._all if s.descriptor]
        lost: list[tuple[int, npt.NDArray[np.float64]]] = []
        for submap in labeled:
            voxels = self._volume.surface_voxels(submap.slot)
            voxels = voxels[seldom_seen(voxels[:, 3])]
            if not len(voxels):
                continue
            points = transform(submap.T_map_submap, voxels[:, :3])
            others = [s.slot for s in self._all.near(submap, [s for s in labeled if s is not submap])]
            lost.append((submap.slot, points[self._volume.most_seen(others, points) > voxels[:, 3]]))
        for slot, points in lost:
            self._volume.disown(slot, points, reach=0)

    def _yield_unlabeled(self) -> None:
        """What was labeled in some frames only is no part of the unlabeled background."""
        if self._all.rest is None:
            return
        for submap in self._all:
            if submap.descriptor:
                points = transform(submap.T_map_submap, self._volume.surface_points(submap.slot))
                self._volume.disown(self._all.rest.slot, points)

    def move(self, corrections: Mapping[int, npt.NDArray[np.float64]]) -> None:
        """Move submaps with the frames that saw them, as `SubmapCollection.move`."""
        self._all.move(corrections)

    @property
    def next_id(self) -> int:
        """The id that the next submap will get."""
        return self._all.next_id

    @property
    def merged(self) -> Mapping[int, int]:
        """Submap that was merged away -> the one that it became part of."""
        return self._all.merged

    def submaps(self) -> tuple[Submap, ...]:
        """Records of all submaps, by id."""
        return self._all.records()

    def blocks(self, submap_id: int) -> VoxelBlocks:
        """Copies of a submap's voxels; raises `InputError` where it has been merged or removed."""
        return self._all.blocks(submap_id)

    def touched(self, submap_id: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """Coordinates of a submap's blocks, (N, 3), and of those written since the last call, (M, 3)."""
        return self._all.touched(submap_id)

    def blocks_at(self, submap_id: int, coords: npt.NDArray[np.int32]) -> VoxelBlocks:
        """Copies of the blocks at some coordinates, (N, 3), all of which exist, sorted."""
        return self._all.blocks_at(submap_id, coords)

    def changes(self) -> tuple[dict[int, VoxelBlocks], dict[int, npt.NDArray[np.int32]]]:
        """Blocks written, and coordinates pruned, since the last call, by submap id."""
        return self._all.changes()

    def restore(self, submaps: Iterable[Submap], source: VoxelSource, next_id: int) -> None:
        """Go on from the records and voxels of a saved map; the fusion must be new."""
        self._all.restore(submaps, source, next_id)
