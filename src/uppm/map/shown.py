"""A map as viewers show it: its submaps with their facts and colours, freespace as points, the camera's way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.categories import plain_name
from uppm.core.geometry import transform
from uppm.core.shown import CHANGE_COLORS, CONFIDENCE_COLORS, UNKNOWN_COLOR, Answers, Color, Content, Shown
from uppm.core.types import Change, FrameRecord, Mesh, Submap, SubmapKind, SubmapState, VoxelBlocks
from uppm.map.palette import submap_color
from uppm.map.panoptic_map import PanopticMap, QueryResult, change_dict, submap_dict

LIMIT = 20
"""Answers to a prompt."""
UNLABELED = "unlabeled"
"""Stands for the category of submaps without a descriptor."""


def content_of(panoptic: PanopticMap, title: str) -> Content:
    """Everything of a map that is shown; meshes it."""
    believed = [s for s in panoptic.submaps if s.state is not SubmapState.TENTATIVE]
    free = [_free_centers(s, panoptic.blocks(s.id)) for s in believed if s.kind is SubmapKind.FREESPACE]
    return Content(
        title=title,
        up=panoptic.up,
        shown=shown_submaps(believed, {s.id: panoptic.submap_mesh(s.id) for s in believed}, panoptic.changes),
        free=np.concatenate([np.empty((0, 3), dtype=np.float32), *free]),
        path=camera_path(panoptic.frames),
        gone=tuple(change_dict(change) for change in panoptic.changes if change.id_new is None),
        ask=lambda text: asked(panoptic, text),
    )


def live_content(panoptic: PanopticMap, meshes: Mapping[int, Mesh]) -> Content:
    """A running map as it is now. It answers prompts of these surfaces: the voxels change while they are asked."""
    surfaces = panoptic.of_surfaces(meshes)
    return Content(
        title="mapping",
        up=panoptic.up,
        shown=shown_submaps(panoptic.submaps, meshes),
        free=np.empty((0, 3), dtype=np.float32),
        path=camera_path(panoptic.frames),
        ask=lambda text: asked(surfaces, text),
    )


def asked(panoptic: PanopticMap, text: str) -> Answers:
    """What `uppm query` answers."""
    reply = panoptic.ask(text, LIMIT)
    note = (reply.note,) if reply.note else ()
    if reply.plain is not None:
        answers = _plain(reply.plain)
        return Answers(ids=answers.ids, said=(*note, *answers.said))
    found = [f"{f.label} #{f.submap.id}" + (f": {'; '.join(f.reasons)}" if f.reasons else "") for f in reply.results]
    count = (f"{reply.count} in all",) if reply.counting or (reply.count or 0) > len(found) else ()
    understood = f"understood as: {reply.understood}"
    return Answers(ids=tuple(f.submap.id for f in reply.results), said=(understood, *note, *count, *found))


def _plain(result: QueryResult) -> Answers:
    """Of a plain phrase: the answers, or that there is none and what comes closest."""
    if not result.found:
        closest = [f"closest: {a.label} #{a.submap.id} ({a.probability:.0%})" for a in result.closest[:1]]
        return Answers(ids=(), said=("nothing here matches", *closest))
    said = tuple(f"{a.label} #{a.submap.id} ({a.probability:.0%})" for a in result.results)
    return Answers(ids=tuple(a.submap.id for a in result.results), said=said)


def shown_submaps(
    submaps: Sequence[Submap], meshes: Mapping[int, Mesh], changes: Sequence[Change] = ()
) -> tuple[Shown, ...]:
    """The submaps that are believed and have a surface, by id."""
    became = {change.id_new: change for change in changes if change.id_new is not None}
    return tuple(
        _shown(s, meshes[s.id], became.get(s.id))
        for s in sorted(submaps, key=lambda s: s.id)
        if s.state is not SubmapState.TENTATIVE and s.id in meshes and len(meshes[s.id].faces)
    )


def camera_path(frames: Sequence[FrameRecord]) -> tuple[tuple[int, npt.NDArray[np.float64]], ...]:
    """Index and T_map_camera (4, 4) of each frame that was integrated, in order."""
    used = [(f.index, f.T_map_camera) for f in frames if f.T_map_camera is not None and not f.skipped]
    return tuple(sorted(used, key=lambda item: item[0]))


def confidence_color(confidence: float) -> Color:
    """Colour of a confidence from 0 to 1."""
    channels = zip(*CONFIDENCE_COLORS, strict=True)
    r, g, b = (round(float(np.interp(confidence, (0.0, 0.5, 1.0), channel))) for channel in channels)
    return r, g, b


def _shown(submap: Submap, mesh: Mesh, change: Change | None) -> Shown:
    descriptor = submap.descriptor
    category = descriptor.category if descriptor else None
    plain = plain_name(category.name) if category else ""
    called = submap.kind is SubmapKind.OBJECT and descriptor is not None and descriptor.labels
    name = called[0].text if called else plain or UNLABELED
    facts: dict[str, Any] = submap_dict(submap) | {
        "name": name,
        "category": category.name if category else UNLABELED,
        "plain_category": plain,
        "supercategory": category.supercategory if category else "",
        "views": submap.views,
        "change": change_dict(change) if change else None,
    }
    colors = {
        "instance": submap_color(submap, "instance"),
        "category": submap_color(submap, "category"),
        "confidence": confidence_color(descriptor.confidence) if descriptor else UNKNOWN_COLOR,
        "change": CHANGE_COLORS[change.state.value] if change else UNKNOWN_COLOR,
    }
    return Shown(submap=submap, mesh=mesh, name=name, facts=facts, colors=colors)


def _free_centers(submap: Submap, blocks: VoxelBlocks) -> npt.NDArray[np.float32]:
    block, *voxel = np.nonzero((blocks.weight > 0) & (blocks.distance > 0))
    at = (8 * blocks.coords[block] + np.stack(voxel, axis=1) + 0.5) * submap.voxel_size
    return transform(submap.T_map_submap, at).astype(np.float32)
