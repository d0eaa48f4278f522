"""The panoptic map as a user sees it: the same over a running fusion and over a map file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from uppm.core.errors import InputError
from uppm.core.protocols import TextEncoder, VoxelSource
from uppm.core.types import FrameRecord, Mesh, Report, Submap, SubmapKind, SubmapState, VoxelBlocks
from uppm.map.palette import submap_color
from uppm.map.store import MapMeta, MapReader

Coloring = Literal["color", "instance", "category"]


class PanopticMap:
    """Submaps with their voxels, labels and report, as they were when it was made; each surface is meshed once.

    Parameters
    ----------
    submaps : the map's submaps, by id.
    voxels : where their voxels are; asked only when they are needed.
    encoder : makes the text encoder, on the first query.
    label_embeddings : label text -> unit vector (D,), as stored with the map.
    """

    def __init__(
        self,
        *,
        submaps: Iterable[Submap],
        voxels: VoxelSource,
        encoder: Callable[[], TextEncoder] | None = None,
        label_embeddings: Mapping[str, npt.NDArray[np.float32]] | None = None,
        report: Report | None = None,
        frames: Iterable[FrameRecord] = (),
        meta: MapMeta | None = None,
    ) -> None:
        self.submaps = tuple(submaps)
        self.frames = tuple(frames)
        self.report = report or Report()
        self.meta = meta or MapMeta()
        self.label_embeddings = dict(label_embeddings or {})
        self._by_id = {submap.id: submap for submap in self.submaps}
        self._meshes: dict[int, Mesh] = {}
        self._voxels, self._make_encoder = voxels, encoder

    @classmethod
    def from_file(cls, reader: MapReader, *, encoder: Callable[[], TextEncoder] | None = None) -> PanopticMap:
        """The map of an open file; no voxels are read yet."""
        return cls(
            submaps=reader.submaps(),
            voxels=reader,
            encoder=encoder,
            label_embeddings=reader.label_embeddings(),
            report=reader.report(),
            frames=reader.frames(),
            meta=reader.meta,
        )

    @property
    def objects(self) -> tuple[Submap, ...]:
        """The things that were seen often enough to be believed."""
        return tuple(s for s in self.submaps if s.kind is SubmapKind.OBJECT and s.state is not SubmapState.TENTATIVE)

    @property
    def up(self) -> npt.NDArray[np.float64]:
        """(3,) unit vector against gravity in frame map, as noted with the map under `up` ("x y z"); else +z."""
        values = [float(v) for v in self.meta.provenance.get("up", "0 0 1").split()]
        return np.array(values) / np.linalg.norm(values)

    def submap(self, submap_id: int) -> Submap:
        """The submap of an id; raises `InputError` where there is none."""
        if submap_id not in self._by_id:
            raise InputError(
                f"submap {submap_id}",
                expected="an id of this map",
                found="none such",
                advice="`uppm info` lists the ids",
            )
        return self._by_id[submap_id]

    def blocks(self, submap_id: int) -> VoxelBlocks:
        """Voxels of a submap."""
        return self._voxels.blocks(self.submap(submap_id).id)

    def submap_mesh(self, submap_id: int, coloring: Coloring = "color") -> Mesh:
        """Surface of one submap, frame map; freespace has none."""
        from uppm.map.mesh import empty_mesh, submap_mesh

        submap = self.submap(submap_id)
        if submap_id not in self._meshes:
            freespace = submap.kind is SubmapKind.FREESPACE
            self._meshes[submap_id] = empty_mesh() if freespace else submap_mesh(submap, self.blocks(submap_id))
        mesh = self._meshes[submap_id]
        if coloring == "color":
            return mesh
        colors = np.tile(np.array(submap_color(submap, coloring), dtype=np.uint8), (len(mesh.vertices), 1))
        return Mesh(vertices=mesh.vertices, normals=mesh.normals, colors=colors, faces=mesh.faces)

    def mesh(self, coloring: Coloring = "color", ids: Iterable[int] | None = None) -> Mesh:
        """Surfaces of the confirmed and inactive submaps, or of `ids`, in one mesh, frame map."""
        from uppm.map.mesh import merged

        if ids is None:
            ids = [s.id for s in self.submaps if s.state is not SubmapState.TENTATIVE]
        return merged([self.submap_mesh(id_, coloring) for id_ in ids])

    def to_dict(self) -> dict[str, Any]:
        """What `uppm info --json` prints: lengths in metres, frame map."""
        return {
            "frames": self.report.frames,
            "units": "m",
            "up": _rounded(self.up),
            "submaps": [submap_dict(s) for s in self.submaps],
            "report": {
                "frames": self.report.frames,
                "skipped": dict(self.report.skipped),
                "dropped": dict(self.report.dropped),
                "seconds": dict(self.report.seconds),
            },
        }


def submap_dict(submap: Submap) -> dict[str, Any]:
    """One submap for programs; `center` and `extent` are None where no surface was seen."""
    seen = bool(np.isfinite(submap.bounds).all())
    descriptor = submap.descriptor
    return {
        "id": submap.id,
        "kind": submap.kind.value,
        "category": descriptor.category.name if descriptor else None,
        "confidence": round(descriptor.confidence, 4) if descriptor else None,
        "labels": {record.text: record.count for record in descriptor.labels} if descriptor else {},
        "voxel_size": submap.voxel_size,
        "center": _rounded(submap.center) if seen else None,
        "extent": _rounded(submap.extent) if seen else None,
        "state": submap.state.value,
        "first_frame": submap.first_frame,
        "last_frame": submap.last_frame,
    }


def _rounded(values: npt.NDArray[np.float64]) -> list[float]:
    return [round(float(v), 4) for v in values]
