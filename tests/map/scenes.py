"""Analytic submaps: signed distance functions written into voxel blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from uppm.core.types import (
    Category,
    Checkpoint,
    DynamicDescriptor,
    FrameRecord,
    LabelRecord,
    Provenance,
    Report,
    Submap,
    SubmapKind,
    SubmapState,
    VoxelBlocks,
)

Points = npt.NDArray[np.float64]
SignedDistance = Callable[[Points], npt.NDArray[np.float64]]

CUP = Category(id=41, name="cup", supercategory="kitchen", is_thing=True, voxel_size=0.02)
CHAIR = Category(id=56, name="chair", supercategory="furniture", is_thing=True, voxel_size=0.03)
WALL = Category(id=171, name="wall", supercategory="structural", is_thing=False, voxel_size=0.05)


def sphere(center: Sequence[float], radius: float) -> SignedDistance:
    return lambda p: np.linalg.norm(p - np.asarray(center), axis=-1) - radius


def box(low: Sequence[float], high: Sequence[float]) -> SignedDistance:
    middle, half = (np.add(low, high)) / 2, (np.subtract(high, low)) / 2

    def distance(p: Points) -> npt.NDArray[np.float64]:
        q = np.abs(p - middle) - half
        return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)

    return distance


def plane(normal: Sequence[float], offset: float) -> SignedDistance:
    n = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    return lambda p: p @ n - offset


def blocks_of(
    sdf: SignedDistance, low: Sequence[float], high: Sequence[float], voxel: float, *, seed: int | None = None
) -> VoxelBlocks:
    """Blocks between two corners that come within the truncation (2 voxels) of the surface; colour follows position.

    With a seed, weights and colours are noisy, as real ones are.
    """
    side = 8 * voxel
    axes = [np.arange(np.floor(a / side), np.ceil(b / side)) for a, b in zip(low, high, strict=True)]
    coords = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.int32)
    voxels = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1)
    points: Points = (8 * coords[:, None, None, None, :] + voxels + 0.5) * np.float64(voxel)
    distance = sdf(points) / (2 * voxel)
    near = (np.abs(distance) < 1).any(axis=(1, 2, 3))
    points, distance = points[near], distance[near]
    n = int(near.sum())
    weight, color = np.full((n, 8, 8, 8), 3.0), 128 + 100 * np.sin(5 * points)
    if seed is not None:
        rng = np.random.default_rng(seed)
        weight = rng.uniform(1, 50, weight.shape)
        color = color + rng.normal(0, 3, color.shape)
    belonging = np.zeros((n, 8, 8, 8, 2), dtype=np.uint8)
    belonging[..., 0] = 3
    return VoxelBlocks(
        coords=coords[near],
        distance=np.rint(np.clip(distance, -1, 1) * 32767).astype(np.int16),
        weight=np.where(distance > -1, weight, 0).astype(np.float32),
        color=np.clip(color, 0, 255).astype(np.uint8),
        belonging=belonging,
    )


def submap_of(
    id_: int,
    category: Category | None = CUP,
    *,
    kind: SubmapKind = SubmapKind.OBJECT,
    state: SubmapState = SubmapState.CONFIRMED,
    bounds: Sequence[Sequence[float]] = ((0, 0, 0), (1, 1, 1)),
    voxel: float = 0.02,
) -> Submap:
    descriptor = None
    if category is not None:
        labels = (label_of(category.name, 7, category), label_of(f"{category.name} thing", 2, category))
        descriptor = DynamicDescriptor(labels=labels, category=category, confidence=0.75)
    pose = np.eye(4)
    pose[:3, 3] = (0.5, -0.25, 1.0)
    return Submap(
        id=id_,
        kind=kind,
        state=state,
        descriptor=descriptor,
        voxel_size=voxel,
        truncation=2 * voxel,
        T_map_submap=pose,
        first_frame=3,
        last_frame=9,
        views=5,
        misses=1,
        evidence=2.5,
        bounds=np.asarray(bounds, dtype=np.float64),
    )


def label_of(text: str, count: int, category: Category) -> LabelRecord:
    return LabelRecord(
        text=text,
        category=category.id,
        count=count,
        weight=0.5 * count,
        provenance=(Provenance.DETECTOR, Provenance.CAPTION),
        first_frame=3,
        last_frame=9,
    )


def checkpoint_of(submaps: Sequence[Submap], **changes: object) -> Checkpoint:
    values: dict[str, object] = {
        "submaps": tuple(submaps),
        "changed": {},
        "pruned": {},
        "next_id": max((s.id for s in submaps), default=0) + 1,
        "frames": (FrameRecord(index=0, stamp=0.5, T_map_camera=np.eye(4)),),
        "label_embeddings": {},
        "report": Report(frames=1),
    }
    return Checkpoint(**{**values, **changes})  # pyright: ignore[reportArgumentType]
