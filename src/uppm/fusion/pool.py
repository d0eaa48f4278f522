"""The block pool: one set of arrays for the voxels of all submaps, reserved at once and paid for as it is used."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm._kernels.hashing import BLOCKS_PER_CHUNK, NONE
from uppm.core.errors import UppmError
from uppm.core.types import VOXELS_PER_SIDE


def reserve(shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """A zeroed array whose pages cost memory only once they are written, so that growing copies nothing."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | getattr(mmap, "MAP_NORESERVE", 0)
    try:
        pages = mmap.mmap(-1, size, flags=flags)
    except OSError as error:
        advice = "lower fusion.max_blocks, or allow the process more address space"
        raise UppmError(f"the block pool cannot reserve {size / 1e9:.1f} GB ({error.strerror}); {advice}") from None
    return np.frombuffer(pages, dtype=dtype).reshape(shape)


class BlockPool:
    """Structure of arrays over blocks and chunks; 11 bytes a voxel.

    Fields named as in `uppm.core.types.VoxelBlocks`. `slot` numbers submaps inside the pool; `state` holds the number
    of free blocks, of free chunks, of chunks in use, and of requests outside the addressable range.
    """

    def __init__(self, max_blocks: int) -> None:
        side = VOXELS_PER_SIDE
        # A chunk on a surface holds about 16 of its 64 blocks; four is the worst seen in sparse freespace.
        chunks = max(64, max_blocks // 4)
        self.capacity = max_blocks
        self.distance = reserve((max_blocks, side, side, side), np.int16)
        self.weight = reserve((max_blocks, side, side, side), np.float32)
        self.color = reserve((max_blocks, side, side, side, 3), np.uint8)
        self.belonging = reserve((max_blocks, side, side, side, 2), np.uint8)
        self.block_coord = reserve((max_blocks, 3), np.int32)
        self.block_slot = reserve((max_blocks,), np.int32)
        self.has_surface = reserve((max_blocks,), np.bool_)
        self.dirty = reserve((max_blocks,), np.uint8)
        self.chunk_coord = reserve((chunks, 3), np.int32)
        self.chunk_slot = reserve((chunks,), np.int32)
        self.chunk_blocks = reserve((chunks, BLOCKS_PER_CHUNK), np.int32)
        self.chunk_used = reserve((chunks,), np.int32)
        self.chunk_next = reserve((chunks,), np.int32)
        self.chunk_prev = reserve((chunks,), np.int32)
        self.free_blocks = np.arange(max_blocks - 1, -1, -1, dtype=np.int32)
        self.free_chunks = np.arange(chunks - 1, -1, -1, dtype=np.int32)
        self.keys = np.full(1 << int(np.ceil(np.log2(2 * chunks))), -1, dtype=np.int64)
        self.values = np.full(len(self.keys), NONE, dtype=np.int32)
        self.state = np.array([max_blocks, chunks, 0, 0], dtype=np.int64)

    @property
    def used(self) -> int:
        """Blocks in use."""
        return self.capacity - int(self.state[0])
