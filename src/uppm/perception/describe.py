"""Semantic retrieval of a segmentation: each segment's label becomes an elementary descriptor (paper section 3.2.2)."""

from __future__ import annotations

from uppm.core.protocols import Retriever
from uppm.core.types import DescribedSegmentation, ElementaryDescriptor, PanopticSegmentation


def describe(segmentation: PanopticSegmentation, retriever: Retriever) -> DescribedSegmentation:
    """The segmentation with e = <label, category, voxel size> for each segment (paper equation 3)."""
    segments = segmentation.segments
    categories = retriever.retrieve([segment.label.text for segment in segments])
    return DescribedSegmentation(
        ids=segmentation.ids,
        descriptors=tuple(
            ElementaryDescriptor(
                label=segment.label.text,
                category=category,
                provenance=segment.label.provenance,
                score=segment.score,
                feature=segment.feature,
            )
            for segment, category in zip(segments, categories, strict=True)
        ),
        is_thing=tuple(segment.is_thing for segment in segments),
    )
