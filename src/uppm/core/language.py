"""The values between an image-to-text model and segmentation (paper section 3.2.1); frozen, as `core.types`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from uppm.core.types import Label


@dataclass(frozen=True, kw_only=True)
class Caption:
    """What an image-to-text model says of one image."""

    text: str = ""
    """A sentence or several, as the model wrote it; empty where the model gives tags only."""
    tags: tuple[str, ...] = ()
    """Names of things, each as the model wrote it; empty where the model gives captions only."""


@dataclass(frozen=True, kw_only=True)
class FrameLabels:
    """The labels of one frame, and what was left out (method.md section 1)."""

    labels: tuple[Label, ...] = ()
    """Each text once, those of the caption first."""
    dropped: Mapping[str, int] = field(default_factory=dict[str, int])
    """Reason -> number of phrases and tags dropped for it."""
    skip: str | None = None
    """Reason for which the frame should not be integrated at all."""
