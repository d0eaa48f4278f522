"""Voxel blocks as compressed bytes; the layout is documented in docs/map-file.md."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
import zstandard

from uppm.core.types import VOXELS_PER_SIDE, VoxelBlocks

VOXELS = VOXELS_PER_SIDE**3
FIELDS = (("distance", "<i2", 1), ("weight", "<f4", 1), ("color", "|u1", 3), ("belonging", "|u1", 2))
"""Name, dtype and channels of each field, in the order of the bytes."""
BLOCK_BYTES = VOXELS * sum(np.dtype(dtype).itemsize * channels for _, dtype, channels in FIELDS)
LEVEL = 1


def encode(blocks: VoxelBlocks) -> Iterator[bytes]:
    """One zstd frame a block, with checksum. Bytes of equal significance lie together, which compresses better."""
    planes = [
        np.ascontiguousarray(getattr(blocks, name), dtype=dtype).view(np.uint8).reshape(len(blocks), VOXELS, -1)
        for name, dtype, _ in FIELDS
    ]
    raw = np.concatenate([plane.transpose(0, 2, 1).reshape(len(blocks), -1) for plane in planes], axis=1)
    compressor = zstandard.ZstdCompressor(level=LEVEL, write_checksum=True)
    return (compressor.compress(row.data) for row in raw)


def decode(coords: npt.NDArray[np.int32], frames: Sequence[bytes]) -> VoxelBlocks:
    """Inverse of `encode`; coords (N, 3), one zstd frame each.

    Raises
    ------
    ValueError
        A frame is damaged or holds another number of bytes.
    """
    n, s = len(frames), VOXELS_PER_SIDE
    raw = np.empty((n, BLOCK_BYTES), dtype=np.uint8)
    decompressor = zstandard.ZstdDecompressor()
    for row, frame in zip(raw, frames, strict=True):
        try:
            # Asked first: a frame may claim any size, and would get the memory for it.
            if zstandard.frame_content_size(frame) != BLOCK_BYTES:
                raise ValueError(f"damaged voxel block (not {BLOCK_BYTES} bytes)")
            row[:] = np.frombuffer(decompressor.decompress(frame), dtype=np.uint8)
        except zstandard.ZstdError as error:
            raise ValueError(f"damaged voxel block ({error})") from None
    arrays, start = {}, 0
    for name, dtype, channels in FIELDS:
        width = np.dtype(dtype).itemsize * channels
        plane = raw[:, start : start + width * VOXELS].reshape(n, width, VOXELS).transpose(0, 2, 1)
        shape = (n, s, s, s, channels) if channels > 1 else (n, s, s, s)
        arrays[name] = np.ascontiguousarray(plane).view(dtype).reshape(shape)
        start += width * VOXELS
    return VoxelBlocks(coords=coords, **arrays)
