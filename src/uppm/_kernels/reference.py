"""NumPy references of the kernels: slow, plain, one submap at a time; what the tests hold the kernels to."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

SIDE = 8
FULL = 32767.0
MIN_Z = 0.05
COLOR_MEMORY = 31.0
BEHIND = 2.0
SHELL, FADE = 0.5, 40.0

Array = npt.NDArray
Camera = tuple[float, ...]


def prepare_depth(depth: Array, ray_length: Array, low: float, high: float) -> tuple[Array, Array]:
    """Depth within range, else 0, and range along the ray; (H, W) each."""
    limited = np.where((depth >= low) & (depth <= high), depth, 0)
    return limited, limited * ray_length


def segment_pixels(ids: Array, depth: Array, segments: int) -> tuple[Array, Array]:
    """Pixels with valid depth and their summed depth, by segment id; (segments + 1,) each."""
    valid = depth > 0
    pixels = np.bincount(ids[valid], minlength=segments + 1)
    return pixels, np.bincount(ids[valid], weights=depth[valid], minlength=segments + 1)


def ray_cosine(depth: Array, rays: Array, least: float) -> Array:
    """Cosine between ray and surface at half resolution, from the flatter of the differences over two pixels."""
    points, (height, width) = rays * depth[..., None], depth.shape
    out = np.ones((-(-height // 2), -(-width // 2)))
    for v in range(0, height, 2):
        for u in range(0, width, 2):
            tangents = [_tangent(points, depth, v, u, *step) for step in ((0, 2), (2, 0))]
            if depth[v, u] > 0 and tangents[0] is not None and tangents[1] is not None:
                normal = np.cross(tangents[0], tangents[1])
                cosine = abs(normal @ points[v, u]) / np.linalg.norm(normal) / np.linalg.norm(points[v, u])
                out[v // 2, u // 2] = np.clip(cosine, least, 1)
    return out


def _tangent(points: Array, depth: Array, v: int, u: int, dv: int, du: int) -> Array | None:
    best = None
    for sign in (1, -1):
        y, x = v + sign * dv, u + sign * du
        if not (0 <= y < depth.shape[0] and 0 <= x < depth.shape[1]) or depth[y, x] <= 0:
            continue
        tangent = (points[y, x] - points[v, u]) * sign
        # The kernel takes the flatter side's slope as the surface's at the pixel itself.
        slope = (depth[y, x] - depth[v, u]) * sign
        if best is None or abs(slope) < abs(best[0]):
            best = slope, tangent
    return None if best is None else best[1]


def band_block_coords(range_image: Array, rays: Array, T_submap_camera: Array, band: float, side: float) -> set:
    """Blocks (bx, by, bz) that the truncation bands of all valid pixels cross, by sampling each band finely."""
    valid = range_image > 0
    unit = rays[valid] / np.linalg.norm(rays[valid], axis=1, keepdims=True)
    out: set[tuple[int, int, int]] = set()
    for offset in np.linspace(-band, band, 65):
        points = unit * (range_image[valid] + offset)[:, None]
        local = points @ T_submap_camera[:3, :3].T + T_submap_camera[:3, 3]
        out |= set(map(tuple, np.unique(np.floor(local / side).astype(int), axis=0).tolist()))
    return out


def voxel_centers(coords: Array, size: float) -> Array:
    """Centres (N, 8, 8, 8, 3) of the voxels of blocks (N, 3), frame submap."""
    offsets = np.stack(np.meshgrid(*[np.arange(SIDE)] * 3, indexing="ij"), axis=-1)
    return (coords[:, None, None, None, :] * SIDE + offsets + 0.5) * size


def sample_range(range_image: Array, u: Array, v: Array, max_step: float) -> Array:
    """Range at pixel coordinates (N,), bilinear, or the nearest pixel's across a step or beside a hole."""
    height, width = range_image.shape
    x0, y0 = u.astype(int), v.astype(int)
    x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
    four = np.stack([range_image[y0, x0], range_image[y0, x1], range_image[y1, x0], range_image[y1, x1]])
    fx, fy = u - x0, v - y0
    bilinear = (four[0] * (1 - fx) + four[1] * fx) * (1 - fy) + (four[2] * (1 - fx) + four[3] * fx) * fy
    nearest = range_image[(v + 0.5).astype(int), (u + 0.5).astype(int)]
    smooth = (four.min(axis=0) > 0) & (four.max(axis=0) - four.min(axis=0) <= max_step)
    return np.where(smooth, bilinear, nearest)


def integrate(
    coords: Array,
    voxels: dict[str, Array],
    images: dict[str, Array],
    camera: Camera,
    T_camera_submap: Array,
    size: float,
    band: float,
    slot: int,
    max_step: float,
    max_weight: float,
    noise_growth: int = 2,
) -> dict[str, Array]:
    """One frame into the blocks of one submap.

    voxels: distance, weight, color, belonging as in the pool, (N, 8, 8, 8, ...); images: range, cosine, slot,
    color. Returns new arrays.
    """
    fx, fy, cx, cy = camera
    height, width = images["range"].shape
    p = voxel_centers(coords, size) @ T_camera_submap[:3, :3].T + T_camera_submap[:3, 3]
    z = np.maximum(p[..., 2], MIN_Z)
    u, v = fx * p[..., 0] / z + cx, fy * p[..., 1] / z + cy
    seen = (p[..., 2] > MIN_Z) & (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    at = np.nonzero(seen)
    measured = sample_range(images["range"], u[at], v[at], max_step)
    incidence = images["cosine"][(v[at] + 0.5).astype(int) // 2, (u[at] + 0.5).astype(int) // 2]
    along = measured - np.linalg.norm(p[at], axis=-1)
    sdf = along * incidence
    keep = (measured > 0) & (sdf >= -band) & (along >= -BEHIND * band)
    at, sdf = tuple(axis[keep] for axis in at), sdf[keep]
    w = fx * fy * size**2 / z[at] ** (2 * noise_growth)
    w = np.where(sdf < -size, w * (sdf + band) / (band - size), w)
    w /= 1 + FADE * np.minimum(sdf / size + SHELL, 0) ** 2
    some = voxels["weight"][at] + w > 0
    return _update(
        voxels, images, tuple(axis[some] for axis in at), sdf[some], w[some], u, v, size, band, slot, max_weight
    )


def _update(voxels, images, at, sdf, w, u, v, size, band, slot, max_weight) -> dict[str, Array]:
    out = {name: array.copy() for name, array in voxels.items()}
    row, column = (v[at] + 0.5).astype(int), (u[at] + 0.5).astype(int)
    total = voxels["weight"][at] + w
    old = voxels["distance"][at] * (band / FULL)
    new = old + (np.minimum(sdf, band) - old) * w / total
    out["distance"][at] = np.rint(new * (FULL / band)).astype(np.int16)
    out["weight"][at] = np.minimum(total, max_weight)
    ids = images["slot"][row, column]
    for n, voxel in enumerate(zip(*at, strict=True)):
        if sdf[n] >= band:
            continue
        counters = out["belonging"][voxel]
        if ids[n] >= 0 and sdf[n] >= -size:
            which = 0 if ids[n] == slot else 1
            if counters[which] == 255:
                counters >>= 1
            counters[which] += 1
        if ids[n] in (slot, -1) and abs(sdf[n]) <= size:
            was = out["color"][voxel].astype(float)
            gain = max(w[n] / total[n], 1 / COLOR_MEMORY)
            out["color"][voxel] = (was + (images["color"][row[n], column[n]] - was) * gain + 0.5).astype(np.uint8)
    return out


def on_surface(voxels: dict[str, Array], limit: float) -> Array:
    """Which voxels were observed, belong, and lie at most `limit` (fixed point) from the surface."""
    near = np.abs(voxels["distance"].astype(np.int32)) <= int(limit)
    belongs = (voxels["belonging"][..., 0] > 0) & (voxels["belonging"][..., 0] >= voxels["belonging"][..., 1])
    return (voxels["weight"] > 0) & near & belongs


def surface_distance(
    coords: Array, voxels: dict[str, Array], depth: Array, rays: Array, T_submap_camera: Array, size: float, band: float
) -> Array:
    """Distance (H, W), metres, of each measured point from one submap's surface; infinite where it is not on it."""
    surface = on_surface(voxels, FULL * size / band)
    index = {tuple(c): n for n, c in enumerate(coords.tolist())}
    out = np.full(depth.shape, np.inf)
    for v, u in np.argwhere(depth > 0):
        point = T_submap_camera[:3, :3] @ (rays[v, u] * depth[v, u]) + T_submap_camera[:3, 3]
        voxel = np.floor(point / size).astype(int)
        n = index.get(tuple((voxel >> 3).tolist()))
        if n is not None and surface[(n, *(voxel & 7))]:
            out[v, u] = abs(int(voxels["distance"][(n, *(voxel & 7))])) / FULL * band
    return out


def count_expected(
    coords: Array, voxels: dict[str, Array], depth: Array, camera: Camera, T_camera_submap: Array,
    size: float, band: float,
) -> tuple[int, int]:  # fmt: skip
    """Surface voxels of one submap that are measured where expected, and that are seen through."""
    fx, fy, cx, cy = camera
    centers = voxel_centers(coords, size)[on_surface(voxels, FULL * size / band * 0.6)]
    p = centers @ T_camera_submap[:3, :3].T + T_camera_submap[:3, 3]
    p = p[p[:, 2] >= MIN_Z]
    u = np.floor(fx * p[:, 0] / p[:, 2] + cx + 0.5).astype(int)
    v = np.floor(fy * p[:, 1] / p[:, 2] + cy + 0.5).astype(int)
    inside = (u >= 0) & (v >= 0) & (u < depth.shape[1]) & (v < depth.shape[0])
    measured, z = depth[v[inside], u[inside]], p[inside, 2]
    difference = (measured - z)[measured > 0]
    agrees = np.abs(difference) <= 2 * size
    return int(agrees.sum()), int((difference[~agrees] > 0).sum())


def dual_vertices(field: Array, constants: dict[str, float]) -> dict[tuple[int, ...], tuple[Array, Array]]:
    """Vertex and normal of each cell of a dense field (X, Y, Z), in voxels, NaN where not observed, by lowest corner.

    For cells that one sheet passes; constants: STEEP, DEEP, ALIKE, PULL, FILL and SLACK of the kernel.
    """
    padded = np.pad(field, 2, constant_values=np.nan)
    out: dict[tuple[int, ...], tuple[Array, Array]] = {}
    for cell in np.ndindex(*(n - 1 for n in field.shape)):
        corner = np.array(cell) + 2
        points, normals, whole = [], [], True
        for axis in range(3):
            for b, c in np.ndindex(2, 2):
                low = corner.copy()
                low[(axis + 1) % 3] += b
                low[(axis + 2) % 3] += c
                step = np.eye(3, dtype=int)[axis]
                ends = padded[tuple(low)], padded[tuple(low + step)]
                if (ends[0] >= 0) == (ends[1] >= 0):
                    continue
                at = dual_crossing(padded, low, step, constants)
                whole &= at is not None
                if at is not None:
                    points.append(low - corner + at * step)
                    nearer = low if abs(ends[0]) <= abs(ends[1]) else low + step
                    normals.append(dual_normal(padded, nearer, constants["ALIKE"]))
        if points:
            out[cell] = _dual_vertex(np.array(points), np.array(normals), whole, constants)
    return out


def dual_crossing(padded: Array, low: Array, step: Array, constants: dict[str, float]) -> float | None:
    """Where the surface crosses an edge, from its lower end, 0 to 1; None where it is not known to."""
    before, a, b, after = (padded[tuple(low + n * step)] for n in (-1, 0, 1, 2))
    if np.isnan(a) or np.isnan(b):
        return None
    if abs(a) + abs(b) <= constants["STEEP"]:
        return float(abs(a) / (abs(a) + abs(b)))
    near, slope = (abs(a), (a - before) * np.sign(b)) if abs(a) <= abs(b) else (abs(b), (after - b) * np.sign(b))
    if slope > near:
        near = min(near / min(slope, 1), 1)
    elif near > constants["DEEP"]:
        return None
    return float(near if abs(a) <= abs(b) else 1 - near)


def dual_normal(padded: Array, voxel: Array, alike: float) -> Array:
    """Of all choices of one-sided differences the gradient whose squared length is nearest to one, as a unit vector."""
    sides = []
    for step in np.eye(3, dtype=int):
        here = padded[tuple(voxel)]
        both = [here - padded[tuple(voxel - step)], padded[tuple(voxel + step)] - here]
        known = [d for d in both if not np.isnan(d)] or [0.0]
        sides.append([np.mean(known)] if len(known) == 2 and abs(known[0] - known[1]) < alike else known)
    choices = [np.array([x, y, z]) for z in sides[2] for y in sides[1] for x in sides[0]]
    best = min(choices, key=lambda g: abs(g @ g - 1))
    return best / max(np.linalg.norm(best), 1e-6)


def _dual_vertex(points: Array, normals: Array, whole: bool, constants: dict[str, float]) -> tuple[Array, Array]:
    middle = points.mean(axis=0)
    if not whole:
        middle = middle + constants["FILL"] * (0.5 - middle)
    pull = np.sqrt(constants["PULL"] * len(points)) * np.eye(3)
    offsets = np.einsum("ij,ij->i", normals, points - middle)
    shift = np.linalg.lstsq(np.vstack([normals, pull]), np.concatenate([offsets, np.zeros(3)]), rcond=None)[0]
    total = normals.sum(axis=0)
    vertex = np.clip(middle + shift, -constants["SLACK"], 1 + constants["SLACK"])
    return vertex, total / max(np.linalg.norm(total), 1e-6)
