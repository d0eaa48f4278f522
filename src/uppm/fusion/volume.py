"""The volume: every submap's voxels in one pool, and what a frame does to them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm._kernels import allocate as _allocate
from uppm._kernels import associate as _associate
from uppm._kernels.camera import PARTS
from uppm._kernels.hashing import BLOCKS_PER_CHUNK, NONE, SLOT_LIMIT, find_blocks
from uppm._kernels.integrate import holds_surface, integrate
from uppm._kernels.surface import FULL, disown, most_seen, surface_points
from uppm._kernels.visible import MAX_CANDIDATES, blocks_to_update, visible_blocks
from uppm.core.errors import UppmError
from uppm.core.geometry import invert, transform
from uppm.core.types import VOXELS_PER_SIDE, VoxelBlocks
from uppm.fusion.pool import BlockPool
from uppm.fusion.view import View

Indices = npt.NDArray[np.int32]
WRITTEN, SAVED, MESHED = 1, 2, 4
"""Marks of a block: written, which is news to all; written and not yet read by who saves the map, or who meshes it."""
NO_SLOTS = np.empty(0, dtype=np.int32)
FREESPACE_RAY_STRIDE = 16
"""Pixels between the rays that allocate freespace: at 5 m under 20 cm apart, far less than a 2.4 m block."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Visible:
    """What a view can touch."""

    blocks: Indices
    """(N,) pool indices."""
    boxes: Indices
    """(N, 4): depth tiles x0, y0, x1, y1 (ends exclusive) that each block projects to."""
    tile_slots: Indices
    """(rows, columns, MAX_CANDIDATES): submaps whose surface meets each depth tile."""
    tile_count: Indices
    """(rows, columns): how many."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """A frame's pixels given to submaps, and room made for them."""

    slot_image: npt.NDArray[np.int32]
    """(H, W): slot of each pixel's submap, or NONE."""
    id_image: npt.NDArray[np.int32]
    """(H, W): id of each pixel's submap, 0 where there is none."""
    new: Indices
    """(N,): pool indices of the blocks created."""
    rows: Indices
    """Slot -> its place in `present`, or NONE."""
    present: npt.NDArray[np.bool_]
    """(rows, columns, submaps): whether a depth tile shows a submap."""


class Volume:
    """Multi-resolution multi-TSDF over one block pool (method.md section 4).

    A submap is known here by its slot; slots are used again after `remove`.
    """

    def __init__(self, max_blocks: int, max_weight: float, max_step: float, noise_growth: int = 2) -> None:
        self.pool = BlockPool(max_blocks)
        self._limits = np.float32(max_step), np.float32(max_weight), noise_growth
        self._head = np.full(64, NONE, dtype=np.int32)
        self._voxel_size = np.zeros(64, dtype=np.float32)
        self._truncation = np.zeros(64, dtype=np.float32)
        self._T_map_submap = np.tile(np.eye(4), (64, 1, 1))
        self._poses: tuple[View, npt.NDArray[np.float32], npt.NDArray[np.float32]] | None = None
        self._free = list(range(63, -1, -1))
        self._freespace = NONE
        self._pruned: dict[int, list[npt.NDArray[np.int32]]] = {}
        self._wanted = np.empty((0, 4096, 4), dtype=np.int64)

    def add(self, voxel_size: float, truncation: float, T_map_submap: npt.NDArray[np.float64], freespace: bool) -> int:
        """A new empty submap; sizes in metres. Returns its slot."""
        if not self._free:
            self._grow_slots()
        slot = self._free.pop()
        self._voxel_size[slot], self._truncation[slot] = voxel_size, truncation
        self.set_pose(slot, T_map_submap)
        self._freespace = slot if freespace else self._freespace
        return slot

    def set_pose(self, slot: int, T_map_submap: npt.NDArray[np.float64]) -> None:
        """Move a submap; its voxels stay as they are in its own frame."""
        self._T_map_submap[slot] = T_map_submap
        if self._poses:
            view, R, t = self._poses
            T = view.T_camera_map @ T_map_submap
            R[slot], t[slot] = T[:3, :3], T[:3, 3]

    def _grow_slots(self) -> None:
        n = len(self._head)
        if 2 * n > SLOT_LIMIT:
            raise UppmError(f"more than {SLOT_LIMIT} submaps at once; raise fusion.min_iou or the detector's score")
        self._head = np.concatenate([self._head, np.full(n, NONE, dtype=np.int32)])
        self._voxel_size = np.concatenate([self._voxel_size, np.zeros(n, dtype=np.float32)])
        self._truncation = np.concatenate([self._truncation, np.zeros(n, dtype=np.float32)])
        self._T_map_submap = np.concatenate([self._T_map_submap, np.tile(np.eye(4), (n, 1, 1))])
        self._poses = None
        self._free = list(range(2 * n - 1, n - 1, -1))

    def _T_camera_submap(self, view: View) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        if self._poses is None or self._poses[0] is not view:
            T = view.T_camera_map @ self._T_map_submap
            self._poses = view, T[:, :3, :3].astype(np.float32), T[:, :3, 3].astype(np.float32)
        return self._poses[1:]

    def visible(self, view: View, slots: Indices) -> Visible:
        """The blocks of these submaps that the view's rays can reach."""
        p, (R, t) = self.pool, self._T_camera_submap(view)
        out, boxes = np.empty(p.used, dtype=np.int32), np.empty((p.used, 4), dtype=np.int32)
        tile_slots = np.empty((*view.tile_min.shape, MAX_CANDIDATES), dtype=np.int32)
        tile_count = np.empty(view.tile_min.shape, dtype=np.int32)
        n = visible_blocks(
            slots, self._head, p.chunk_next, p.chunk_coord, p.chunk_blocks, p.block_coord, p.has_surface,
            R, t, self._voxel_size, self._truncation, view.camera, view.shape, view.depth_max,
            view.tile_min, view.tile_max, self._freespace, out, boxes, tile_slots, tile_count,
        )  # fmt: skip
        return Visible(blocks=out[:n], boxes=boxes[:n], tile_slots=tile_slots, tile_count=tile_count)

    def overlap(
        self, view: View, visible: Visible, slots: Indices, ids: npt.NDArray[np.int32], segments: int
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Pixels where submap slots[i] is rendered, by segment id, and what the segments themselves measure.

        Returns the overlap (len(slots), segments + 1); each segment's pixels with depth (segments + 1,); their mean
        depth (segments + 1,), metres; 0: unlabeled. Pixels are the full image's, counted at `view.stride`.
        """
        p, (R, t) = self.pool, self._T_camera_submap(view)
        counts = np.zeros((PARTS, len(slots), segments + 1), dtype=np.int32)
        pixels, total = np.zeros((PARTS, segments + 1), dtype=np.int64), np.zeros((PARTS, segments + 1))
        _associate.count_overlap(
            visible.tile_slots, visible.tile_count, self._rows(slots), view.depth, view.ray_x, view.ray_y, ids,
            view.stride, p.keys, p.values, p.chunk_blocks, R, t, self._voxel_size, self._truncation,
            p.distance, p.weight, p.belonging, counts, pixels, total,
        )  # fmt: skip
        area, seen = view.stride**2, pixels.sum(axis=0)
        return counts.sum(axis=0, dtype=np.int64) * area, seen * area, total.sum(axis=0) / np.maximum(seen, 1)

    def rendered(self, view: View, visible: Visible, slots: Indices) -> npt.NDArray[np.int32]:
        """Which of these submaps each pixel shows, (H, W): 0 none, k: slots[k - 1]."""
        p, (R, t) = self.pool, self._T_camera_submap(view)
        numbers = np.arange(view.depth.size, dtype=np.int32).reshape(view.depth.shape)
        out = np.zeros(view.depth.size, dtype=np.int32)
        _associate.render_rows(
            visible.tile_slots, visible.tile_count, self._rows(slots), view.depth, view.ray_x, view.ray_y, numbers,
            p.keys, p.values, p.chunk_blocks, R, t, self._voxel_size, self._truncation,
            p.distance, p.weight, p.belonging, out,
        )  # fmt: skip
        return out.reshape(view.depth.shape)

    def to_update(self, visible: Visible, placed: Placed) -> Indices:
        """The visible blocks in which the frame can change a surface, of the placed submaps and of freespace."""
        p, out = self.pool, np.empty(len(visible.blocks), dtype=np.int32)
        n = blocks_to_update(
            visible.blocks,
            visible.boxes,
            p.has_surface,
            p.block_slot,
            placed.rows,
            placed.present,
            self._freespace,
            out,
        )
        return out[:n]

    def expected(self, view: View, blocks: Indices, slots: Indices) -> npt.NDArray[np.int64]:
        """Surface voxels of submap slots[i] that are measured where expected, and that are seen through; (n, 2)."""
        p, (R, t) = self.pool, self._T_camera_submap(view)
        surface = blocks[p.has_surface[blocks]]
        counts = np.zeros((PARTS, len(slots), 2), dtype=np.int32)
        _associate.count_expected(
            surface, self._rows(slots), view.depth, view.camera, R, t, self._voxel_size, self._truncation,
            p.block_coord, p.block_slot, p.distance, p.weight, p.belonging, counts,
        )  # fmt: skip
        return counts.sum(axis=0, dtype=np.int64)

    def _rows(self, slots: Indices) -> Indices:
        rows = np.full(len(self._head), NONE, dtype=np.int32)
        rows[slots] = np.arange(len(slots))
        return rows

    def place(
        self, view: View, ids: npt.NDArray[np.int32], slot_of: Indices, number_of: Indices, active: Indices
    ) -> Placed:
        """Give each pixel its submap, and create the blocks of all pixels' truncation bands, and freespace.

        ids (H, W): segment ids; slot_of, number_of (segments + 1,): slot, or NONE, and id of each segment's submap;
        active: slots whose presence in the tiles is asked for.
        """
        p, (R, t), rows = self.pool, self._T_camera_submap(view), self._rows(active)
        slot_image, id_image = np.empty_like(ids), np.empty_like(ids)
        present = np.empty((*view.tile_min.shape, len(active)), dtype=np.bool_)
        counts = np.zeros(len(present), dtype=np.int64)
        while True:
            if self._wanted.shape[0] < len(present) or counts.max() >= self._wanted.shape[1]:
                size = 2 * self._wanted.shape[1] if counts.max() else self._wanted.shape[1]
                self._wanted = np.empty((len(present), size, 4), dtype=np.int64)
            _allocate.missing_blocks(
                ids, slot_of, number_of, view.depth, view.ray_x, view.ray_y, p.keys, p.values, p.chunk_blocks, R, t,
                self._voxel_size, self._truncation, rows, slot_image, id_image, present, self._wanted, counts,
            )  # fmt: skip
            if counts.max() < self._wanted.shape[1]:
                break
        wanted = np.concatenate([self._wanted[i, :n] for i, n in enumerate(counts.tolist())])
        new = self._add(wanted, len(wanted))
        if self._freespace != NONE:
            new = np.concatenate([new, self._allocate_freespace(view, R, t)])
        return Placed(slot_image=slot_image, id_image=id_image, new=new, rows=rows, present=present)

    def _allocate_freespace(self, view: View, R: npt.NDArray[np.float32], t: npt.NDArray[np.float32]) -> Indices:
        p, f, added = self.pool, self._freespace, [NO_SLOTS]
        while True:
            wanted = self._wanted.reshape(-1, 4)
            n = _allocate.missing_along_rays(
                view.range_image, view.ray_x, view.ray_y, FREESPACE_RAY_STRIDE, f, p.keys, p.values, p.chunk_blocks,
                R[f], t[f], self._voxel_size[f] * np.float32(VOXELS_PER_SIDE), self._truncation[f], wanted,
            )  # fmt: skip
            added.append(self._add(wanted, n))
            # A full list: what it holds exists now, so the next pass finds the rest.
            if n < len(wanted):
                return np.concatenate(added)

    def _add(self, wanted: npt.NDArray[np.int64], n: int) -> Indices:
        if not n:
            return NO_SLOTS
        p, out = self.pool, np.empty(n, dtype=np.int32)
        count = _allocate.add_blocks(
            wanted, n, p.keys, p.values, self._head, p.chunk_next, p.chunk_prev, p.chunk_coord, p.chunk_slot,
            p.chunk_blocks, p.chunk_used, p.free_chunks, p.block_coord, p.block_slot, p.free_blocks, p.state, out,
        )  # fmt: skip
        if count < 0:
            raise UppmError(f"the map needs more than {p.capacity} blocks; raise fusion.max_blocks")
        new = out[:count]
        p.distance[new], p.weight[new], p.color[new], p.belonging[new] = 0, 0, 0, 0
        p.has_surface[new], p.dirty[new] = False, True
        return new

    def integrate(
        self,
        view: View,
        blocks: Indices,
        slot_image: npt.NDArray[np.int32],
        rest: int = NONE,
        objects: Indices = NO_SLOTS,
    ) -> None:
        """Update the voxels of these blocks with the view.

        slot_image (H, W): each pixel's submap slot, or -1; rest: the slot that takes pixels without a label; objects:
        slots of the objects that have a segment in this frame.
        """
        observed = np.zeros(len(self._head), dtype=np.bool_)
        observed[objects] = True
        p, (R, t) = self.pool, self._T_camera_submap(view)
        max_step, max_weight, noise_growth = self._limits
        integrate(
            blocks, view.range_image, view.cosine, slot_image, view.color, view.camera,
            max_step, max_weight, noise_growth, self._freespace, rest, observed, R, t,
            self._voxel_size, self._truncation,
            p.block_coord, p.block_slot, p.distance, p.weight, p.color, p.belonging, p.has_surface, p.dirty,
        )  # fmt: skip

    def indices(self, slot: int) -> Indices:
        """Pool indices of all blocks of a submap, sorted by coordinates."""
        p, found, chunk = self.pool, [], self._head[slot]
        while chunk != NONE:
            blocks = p.chunk_blocks[chunk, :BLOCKS_PER_CHUNK]
            found.append(blocks[blocks != NONE])
            chunk = p.chunk_next[chunk]
        if not found:
            return np.empty(0, dtype=np.int32)
        blocks = np.concatenate(found)
        return blocks[np.lexsort(p.block_coord[blocks].T[::-1])]

    def surface_points(self, slot: int) -> npt.NDArray[np.float64]:
        """Centres (N, 3) of a submap's surface voxels; frame submap, metres.

        They lie at most 0.6 voxels from the surface: half a voxel misses a plane that runs midway between voxels.
        """
        return self.surface_voxels(slot)[:, :3]

    def surface_voxels(self, slot: int) -> npt.NDArray[np.float64]:
        """As `surface_points`, with the times that each voxel was seen as the submap's: (N, 4)."""
        p, blocks = self.pool, self.indices(slot)
        blocks = blocks[p.has_surface[blocks]]
        out = np.empty((64 * len(blocks), 4))
        arrays = blocks, p.block_coord, p.distance, p.weight, p.belonging, self._limit(slot, 0.6)
        n = surface_points(*arrays, float(self._voxel_size[slot]), out)
        if n > len(out):
            out = np.empty((n, 4))
            surface_points(*arrays, float(self._voxel_size[slot]), out)
        return out[:n]

    def most_seen(self, slots: Iterable[int], points: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
        """The most times (N,) that one of these submaps was seen as the surface at points (N, 3), frame map."""
        p, seen = self.pool, np.zeros(len(points), dtype=np.int64)
        for slot in slots:
            local, size = transform(invert(self._T_map_submap[slot]), points), float(self._voxel_size[slot])
            arrays = p.keys, p.values, p.chunk_blocks, p.distance, p.weight, p.belonging
            most_seen(local, slot, *arrays, self._limit(slot, 1.0), size, seen)
        return seen

    def disown(self, slot: int, points: npt.NDArray[np.float64], reach: int = 1) -> None:
        """Let a submap's surface at points (N, 3), frame map, and `reach` voxels around them, belong to another."""
        p, local = self.pool, transform(invert(self._T_map_submap[slot]), points)
        size = float(self._voxel_size[slot])
        disown(local, slot, p.keys, p.values, p.chunk_blocks, p.belonging, p.dirty, size, reach)

    def _limit(self, slot: int, voxels: float) -> int:
        """A distance in voxels in the fixed point of a submap's distances."""
        return int(FULL * voxels * self._voxel_size[slot] / self._truncation[slot])

    def gather(self, blocks: Indices) -> VoxelBlocks:
        """Copies of the voxels of these blocks, which must be one submap's."""
        p = self.pool
        return VoxelBlocks(
            coords=p.block_coord[blocks],
            distance=p.distance[blocks],
            weight=p.weight[blocks],
            color=p.color[blocks],
            belonging=p.belonging[blocks],
        )

    def put(self, slot: int, blocks: VoxelBlocks) -> None:
        """Write voxels into a submap, replacing blocks that exist."""
        if not len(blocks):
            return
        p, n = self.pool, len(blocks)
        wanted = np.column_stack([np.full(n, slot), blocks.coords]).astype(np.int64)
        self._add(wanted, n)
        at = self.find(slot, blocks.coords)
        p.distance[at], p.weight[at], p.color[at] = blocks.distance, blocks.weight, blocks.color
        p.belonging[at], p.dirty[at] = blocks.belonging, True
        one_voxel = self._limit(slot, 1.0)
        for b in at:
            p.has_surface[b] = holds_surface(p.distance[b], p.weight[b], p.belonging[b], one_voxel)

    def find(self, slot: int, coords: npt.NDArray[np.int32]) -> Indices:
        """Pool indices (N,) of a submap's blocks at coordinates (N, 3); NONE where there is none."""
        p, out = self.pool, np.empty(len(coords), dtype=np.int32)
        find_blocks(p.keys, p.values, p.chunk_blocks, slot, coords, out)
        return out

    def drop(self, slot: int, blocks: Indices) -> None:
        """Return blocks of a submap to the pool."""
        p = self.pool
        self._pruned.setdefault(slot, []).append(p.block_coord[blocks].copy())
        _allocate.drop_blocks(
            blocks, p.keys, p.values, self._head, p.chunk_next, p.chunk_prev, p.chunk_coord, p.chunk_slot,
            p.chunk_blocks, p.chunk_used, p.free_chunks, p.block_coord, p.block_slot, p.free_blocks, p.state,
        )  # fmt: skip

    def prune(self, slot: int) -> None:
        """Return the blocks of a submap that hold no part of a truncation band."""
        p, blocks = self.pool, self.indices(slot)
        band = (p.weight[blocks] > 0) & (np.abs(p.distance[blocks]) < FULL)
        self.drop(slot, blocks[~band.any(axis=(1, 2, 3))])

    def replace(self, slot: int, voxel_size: float, truncation: float, blocks: VoxelBlocks) -> None:
        """Give a submap other voxels at another voxel size; metres."""
        self.drop(slot, self.indices(slot))
        self._voxel_size[slot], self._truncation[slot] = voxel_size, truncation
        self.put(slot, blocks)

    def remove(self, slot: int) -> None:
        """Return a submap's blocks and its slot."""
        self.drop(slot, self.indices(slot))
        self._pruned.pop(slot, None)
        self._free.append(slot)

    def take_written(self, slot: int, reader: int) -> Indices:
        """Blocks of a submap that were written since this reader, SAVED or MESHED, asked last."""
        blocks = self.indices(slot)
        marks = self.pool.dirty[blocks]
        marks = np.where(marks & WRITTEN, SAVED | MESHED, marks)
        self.pool.dirty[blocks] = marks - (marks & reader)
        return blocks[(marks & reader) > 0]

    def changes(self, slot: int) -> tuple[VoxelBlocks, npt.NDArray[np.int32]]:
        """Blocks written and coordinates (N, 3) pruned since the last call for this submap."""
        blocks = self.take_written(slot, SAVED)
        pruned = self._pruned.pop(slot, [])
        return self.gather(blocks), np.concatenate(pruned) if pruned else np.empty((0, 3), dtype=np.int32)
