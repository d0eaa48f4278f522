"""The conventions that a sequence may follow other than those it was opened with."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import product

from uppm.core.config import InputConfig
from uppm.core.types import Intrinsics
from uppm.datasets.sequence import PosedSequence

DEPTH_SCALES = (1.0, 1000.0, 5000.0, 6553.5)
"""Units a metre in use: float metres, millimetres, TUM, Replica."""


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Conventions that the sequence may really follow."""

    config: InputConfig
    kinds: tuple[str, ...] = ()
    """What differs from as given: poses, depth-scale, intrinsics."""
    name: str = "as given"
    """As in "0.9 cm inverted"."""
    claim: str = ""
    """As in "poses look inverted"."""
    fix: str = ""
    """As in "use --invert-poses"."""
    depth_factor: float = 1.0
    """Of the depth as given."""
    intrinsics_factor: float = 1.0
    """Resolution of the images over that of the intrinsics."""


def single_hypotheses(source: PosedSequence) -> list[Hypothesis]:
    """One kind of mistake each; pose conventions count as one kind, and are combined."""
    return [*_poses(source), *_depth_scales(source), *_resolutions(source)]


def joint_hypotheses(source: PosedSequence) -> Iterator[Hypothesis]:
    """Two or three kinds of mistake at once."""
    given = Hypothesis(config=source.config)
    choices = ([given, *kind(source)] for kind in (_poses, _depth_scales, _resolutions))
    for pose, depth, resolution in product(*choices):
        parts = [part for part in (pose, depth, resolution) if part is not given]
        if len(parts) > 1:
            yield Hypothesis(
                config=pose.config,
                kinds=tuple(kind for part in parts for kind in part.kinds),
                name=" and ".join(part.name for part in parts),
                claim=" and ".join(part.claim for part in parts),
                fix=_joined(part.fix for part in parts),
                depth_factor=depth.depth_factor,
                intrinsics_factor=resolution.intrinsics_factor,
            )


def scaled(intrinsics: Intrinsics, factor: float) -> Intrinsics:
    """Intrinsics of the same camera at another resolution, with this image size."""
    return Intrinsics(
        fx=intrinsics.fx * factor,
        fy=intrinsics.fy * factor,
        cx=(intrinsics.cx + 0.5) * factor - 0.5,
        cy=(intrinsics.cy + 0.5) * factor - 0.5,
        width=intrinsics.width,
        height=intrinsics.height,
    )


def _poses(source: PosedSequence) -> Iterator[Hypothesis]:
    changes = _pose_changes(source.config)
    for chosen in product((False, True), repeat=3 if source.raw.quaternions else 2):
        parts = [change for change, take in zip(changes, chosen, strict=False) if take]
        if parts:
            name = " and ".join(name for name, _, _ in parts)
            yield Hypothesis(
                config=source.config.model_copy(
                    update={key: value for _, part, _ in parts for key, value in part.items()}
                ),
                kinds=("poses",),
                name=name,
                claim=f"poses look {name}".replace("look with", "look written with"),
                fix=_joined(fix for _, _, fix in parts),
            )


def _joined(fixes: Iterable[str]) -> str:
    return " and ".join(fixes).replace(" and use ", " and ")


def _pose_changes(config: InputConfig) -> list[tuple[str, dict[str, object], str]]:
    """(name, settings, advice) of each convention that may be the other way round."""
    axes, order = config.pose_axes, config.quaternion_order
    return [
        ("not inverted", {"invert_poses": False}, "drop --invert-poses")
        if config.invert_poses
        else ("inverted", {"invert_poses": True}, "use --invert-poses"),
        ("with OpenGL axes", {"pose_axes": "opengl"}, "use --pose-axes opengl")
        if axes == "opencv"
        else ("with OpenCV axes", {"pose_axes": "opencv"}, "use --pose-axes opencv"),
        ("with quaternions as wxyz", {"quaternion_order": "wxyz"}, "use --quaternion-order wxyz")
        if order == "xyzw"
        else ("with quaternions as xyzw", {"quaternion_order": "xyzw"}, "use --quaternion-order xyzw"),
    ]


def _depth_scales(source: PosedSequence) -> Iterator[Hypothesis]:
    for scale in DEPTH_SCALES:
        factor = source.depth_scale / scale
        if abs(factor - 1) > 0.01:
            yield Hypothesis(
                config=source.config,
                kinds=("depth-scale",),
                name=f"at {scale:g} depth units a metre",
                claim=f"depth looks like {scale:g} units a metre, not {source.depth_scale:g}",
                fix=f"use --depth-scale {scale:g}",
                depth_factor=factor,
            )


def _resolutions(source: PosedSequence) -> Iterator[Hypothesis]:
    camera = source.raw.color
    centred = camera.width / (2 * camera.cx + 1) if camera.cx > 0 else 1.0
    ratio = float(Fraction(centred).limit_denominator(8))  # images are scaled by simple ratios
    centred = ratio if abs(ratio / centred - 1) < 0.01 else centred
    factors = [0.5, 2.0] + [centred] * (abs(centred - 1) > 0.1 and min(abs(centred - 0.5), abs(centred - 2)) > 0.02)
    for factor in factors:
        fit = scaled(camera, factor)
        K = f"fx {fit.fx:.1f}, fy {fit.fy:.1f}, cx {fit.cx:.1f}, cy {fit.cy:.1f}"
        size = f"{camera.width / factor:.0f}x{camera.height / factor:.0f}"
        yield Hypothesis(
            config=source.config,
            kinds=("intrinsics",),
            name=f"with intrinsics scaled by {factor:.3g}",
            claim=f"intrinsics look made for {size} images, these are {camera.width}x{camera.height}",
            fix=f"put {K} into {source.raw.intrinsics_source}",
            intrinsics_factor=factor,
        )
