"""Triangles from voxel blocks: dual marching cubes block by block, joined, coloured (docs/architecture.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm._kernels.meshing import find_cells, make_quads, make_vertices
from uppm.core.geometry import transform
from uppm.core.types import Mesh, Submap, VoxelBlocks

FULL = 32767.0
SPAN = 1 << 20
"""Block coordinates lie in [-SPAN, SPAN)."""
AROUND = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
"""(27, 3): offsets of a block's neighbours; `places` of the kernels."""
_FILL_RINGS = 4
"""Vertices so far from one with a colour get theirs from their neighbours."""
_NO_QUADS = np.empty((0, 4, 2), dtype=np.int32)

Keys = npt.NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """What one block adds to its submap's mesh."""

    vertices: npt.NDArray[np.float32]
    """(V, 3), in voxels from voxel (0, 0, 0)'s centre, frame submap."""
    normals: npt.NDArray[np.float32]
    """(V, 3), frame submap."""
    colors: npt.NDArray[np.float32]
    """(V, 3), 0 to 255; NaN for none."""
    quads: npt.NDArray[np.int32]
    """(Q, 4, 2): the block of each corner, as its place in `AROUND`, and the vertex within that block."""
    cases: npt.NDArray[np.uint8]
    """(2, 8, 8, 8): case and seen sheets of each cell."""
    first: npt.NDArray[np.int16]
    """(8, 8, 8): first vertex of each cell."""


def submap_mesh(submap: Submap, blocks: VoxelBlocks) -> Mesh:
    """The surface that belongs to a submap, frame map.

    A grid edge whose ends were observed on different sides of the surface gives two triangles, if one end belongs to
    the submap. A voxel belongs only if the submap's surface was ever seen at it: one that rays merely passed has both
    counters at 0 and says nothing of a surface.
    """
    if not len(blocks):
        return empty_mesh()
    keys = block_keys(blocks.coords)
    return joined(submap, pieces(submap, blocks, keys, keys, {}))


def block_keys(coords: npt.NDArray[np.integer]) -> Keys:
    """One number a block coordinate (..., 3), in the order of sorted coordinates."""
    c = coords.astype(np.int64) + SPAN
    return (c[..., 0] * 2 * SPAN + c[..., 1]) * 2 * SPAN + c[..., 2]


def around(keys: Keys) -> Keys:
    """(N, 27): keys of the blocks around each, in the order of `AROUND`."""
    return keys[:, None] + ((AROUND[:, 0] * 2 * SPAN + AROUND[:, 1]) * 2 * SPAN + AROUND[:, 2])


def positions(keys: Keys, wanted: Keys) -> npt.NDArray[np.int32]:
    """Index of each wanted key among sorted ones, -1 where it is not there."""
    if not len(keys):
        return np.full(wanted.shape, -1, dtype=np.int32)
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[at] == wanted, at, -1).astype(np.int32)


def pieces(
    submap: Submap, blocks: VoxelBlocks, reshaped: Keys, changed: Keys, known: Mapping[int, Piece]
) -> dict[int, Piece]:
    """The pieces of some blocks, by key.

    Parameters
    ----------
    blocks : these blocks and those around them, sorted.
    reshaped : keys of the blocks whose vertices are to be made.
    changed : keys of the blocks whose quads are to be made, those of `reshaped` and some after them.
    known : pieces as they were; those of `reshaped` blocks are not looked at.
    """
    keys, n = block_keys(blocks.coords), len(blocks)
    near, scale = positions(keys, around(keys)), np.float32(submap.truncation / submap.voxel_size / FULL)
    cells, first = np.zeros((2, n, 8, 8, 8), dtype=np.uint8), np.zeros((n, 8, 8, 8), dtype=np.int16)
    for row, key in enumerate(keys.tolist()):
        if key in known:
            cells[:, row], first[row] = known[key].cases, known[key].first
    here, counts = positions(keys, reshaped), np.zeros(len(reshaped), dtype=np.int64)
    find_cells(here, near, blocks.distance, blocks.weight, scale, cells[0], cells[1], counts)
    ends = np.cumsum(counts)
    vertices, normals, colors = (np.empty((int(counts.sum()), 3), dtype=np.float32) for _ in range(3))
    make_vertices(
        here, near, blocks.coords, blocks.distance, blocks.weight, blocks.color, blocks.belonging, scale,
        cells[0], cells[1], ends - counts, first, vertices, normals, colors,
    )  # fmt: skip
    quads = _quads(blocks, near, scale, cells, first, positions(keys, changed))
    made = dict(zip(reshaped.tolist(), _parts(ends, vertices, normals, colors), strict=True))
    out: dict[int, Piece] = {}
    for key, row, own in zip(changed.tolist(), positions(keys, changed).tolist(), quads, strict=True):
        v, normal, color = made[key] if key in made else (known[key].vertices, known[key].normals, known[key].colors)
        out[key] = Piece(
            vertices=v, normals=normal, colors=color, quads=own, cases=cells[:, row].copy(), first=first[row].copy()
        )
    return out


def _parts(ends: Keys, *arrays: npt.NDArray[np.float32]) -> Iterable[tuple[npt.NDArray[np.float32], ...]]:
    return zip(*(np.split(array, ends[:-1]) for array in arrays), strict=True)


def _quads(
    blocks: VoxelBlocks,
    near: npt.NDArray[np.int32],
    scale: np.float32,
    cells: npt.NDArray[np.uint8],
    first: npt.NDArray[np.int16],
    rows: npt.NDArray[np.int32],
) -> list[npt.NDArray[np.int32]]:
    """Quads of each of the blocks in `rows`."""
    given = rows, near, blocks.distance, blocks.weight, blocks.belonging, scale, cells[0], cells[1], first
    counts = np.zeros(len(rows), dtype=np.int64)
    make_quads(*given, counts, counts, _NO_QUADS)
    ends, total = np.cumsum(counts), int(counts.sum())
    out = np.empty((total, 4, 2), dtype=np.int32)
    if total:
        make_quads(*given, counts.copy(), ends - counts, out)
    return np.split(out, ends[:-1])


def joined(submap: Submap, parts: Mapping[int, Piece]) -> Mesh:
    """One mesh, frame map, of all pieces of a submap."""
    keys = np.array(sorted(parts), dtype=np.int64)
    if not len(keys):
        return empty_mesh()
    ordered = [parts[key] for key in keys.tolist()]
    starts = np.cumsum([0] + [len(piece.vertices) for piece in ordered[:-1]])
    near, owner = positions(keys, around(keys)), np.repeat(np.arange(len(keys)), [len(p.quads) for p in ordered])
    corners = np.concatenate([piece.quads for piece in ordered])
    quads = starts[near[owner[:, None], corners[..., 0]]] + corners[..., 1]
    voxels = np.concatenate([piece.vertices for piece in ordered])
    used = np.zeros(len(voxels), dtype=np.bool_)
    used[quads] = True
    faces = (np.cumsum(used) - 1)[_triangles(voxels, quads)].astype(np.int32)
    normals = np.concatenate([piece.normals for piece in ordered])[used] @ submap.T_map_submap[:3, :3].T
    colors = np.concatenate([piece.colors for piece in ordered])[used]
    vertices = transform(submap.T_map_submap, (voxels[used].astype(np.float64) + 0.5) * submap.voxel_size)
    return Mesh(
        vertices=vertices.astype(np.float32),
        normals=normals.astype(np.float32),
        colors=_filled(colors, faces),
        faces=faces,
    )


def _triangles(vertices: npt.NDArray[np.float32], quads: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    """Two triangles (2 Q, 3) a quad, on both sides of its shorter diagonal."""
    corner = vertices[quads]
    turn = np.linalg.norm(corner[:, 0] - corner[:, 2], axis=1) > np.linalg.norm(corner[:, 1] - corner[:, 3], axis=1)
    turned = np.where(turn[:, None], np.roll(quads, -1, axis=1), quads)
    return turned[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def empty_mesh() -> Mesh:
    """A mesh without vertices."""
    none = np.empty((0, 3))
    return Mesh(
        vertices=none.astype(np.float32),
        normals=none.astype(np.float32),
        colors=none.astype(np.uint8),
        faces=none.astype(np.int32),
    )


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one, unwelded."""
    if not meshes:
        return empty_mesh()
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    faces = [m.faces + np.int32(start) for m, start in zip(meshes, starts, strict=True)]
    return Mesh(
        vertices=np.concatenate([m.vertices for m in meshes]),
        normals=np.concatenate([m.normals for m in meshes]),
        colors=np.concatenate([m.colors for m in meshes]),
        faces=np.concatenate(faces).astype(np.int32),
    )


def _filled(colors: npt.NDArray[np.float32], faces: npt.NDArray[np.int32]) -> npt.NDArray[np.uint8]:
    """Colours with NaN replaced, ring by ring, by the mean of the vertices around."""
    near, far = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    for _ in range(_FILL_RINGS):
        gap = np.isnan(colors[:, 0])
        use = gap[near] & ~gap[far]
        if not use.any():
            break
        at, count = near[use], np.bincount(near[use], minlength=len(colors))
        for channel in range(3):
            total = np.bincount(at, colors[far[use], channel], len(colors))
            np.divide(total, count, out=colors[:, channel], where=count > 0, casting="same_kind")
    return np.rint(np.nan_to_num(colors)).astype(np.uint8)
