"""What is to be measured: a map file, or a mesh of any system."""

from __future__ import annotations

from pathlib import Path

from uppm.core.types import SubmapKind, SubmapState
from uppm.evaluation.map_evaluation import Reconstruction
from uppm.evaluation.panmap_metrics import TsdfLayer
from uppm.evaluation.sampling import SurfacePart
from uppm.map.panoptic_map import PanopticMap
from uppm.pipeline import open_map


def open_reconstruction(path: Path) -> Reconstruction:
    """A map file's submaps with their voxels, or a mesh or point cloud of any system as one part.

    Raises
    ------
    InputError
        The file cannot be read, or is none of these.
    """
    if path.suffix.lower() == ".uppm":
        return map_reconstruction(open_map(path), str(path))
    from uppm.evaluation.meshes import read_mesh

    return Reconstruction(source=str(path), parts=(SurfacePart(id=1, mesh=read_mesh(path)),))


def map_reconstruction(panoptic_map: PanopticMap, source: str) -> Reconstruction:
    """What a map claims to be there: its submaps without freespace and tentative ones."""
    submaps = [
        submap
        for submap in panoptic_map.submaps
        if submap.kind is not SubmapKind.FREESPACE and submap.state is not SubmapState.TENTATIVE
    ]
    parts = [
        SurfacePart(
            id=submap.id,
            mesh=panoptic_map.submap_mesh(submap.id),
            category=submap.descriptor.category.name if submap.descriptor else None,
            is_object=submap.kind is SubmapKind.OBJECT,
            score=submap.descriptor.confidence if submap.descriptor else 0.0,
        )
        for submap in submaps
    ]
    layers = [
        TsdfLayer(
            blocks=panoptic_map.blocks(submap.id),
            voxel_size=submap.voxel_size,
            truncation=submap.truncation,
            T_map_submap=submap.T_map_submap,
        )
        for submap in submaps
    ]
    return Reconstruction(source=source, parts=tuple(parts), layers=tuple(layers))
