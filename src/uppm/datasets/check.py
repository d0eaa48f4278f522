"""What users get wrong in a sequence, judged from the data: one finding each, with its fix."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from uppm.core.errors import BadFrameError
from uppm.core.geometry import invert, rotation_angle
from uppm.datasets.hypotheses import DEPTH_SCALES, Hypothesis, joint_hypotheses, single_hypotheses
from uppm.datasets.poses import pose_matrix
from uppm.datasets.reprojection import Agreement, View, agreement, pair_agreement, partners, view
from uppm.datasets.sequence import PosedSequence

PAIRS, QUICK_PAIRS = 40, 12
CLEARLY = 0.5
"""Another hypothesis wins where its disagreement is below this share of that as given."""
PLAUSIBLE = 0.03
"""Disagreement over depth up to which a hypothesis may be the truth; sensors and their poses stay below it."""
GOOD = 0.003
"""Disagreement over depth at which no other hypothesis is preferred, however well it does."""
SANE_DEPTH = (0.1, 50.0)
"""Metres, for the median depth of a hand-held or robot-borne camera."""
MIN_JUMP, MIN_TURN, STEP_RATIO = 0.1, np.deg2rad(10), 1.5
"""Metres or radians between neighbours, and ratio to the median step, from which a step is compared with the images."""
JUMP_RATIO = 3.0
"""Ratio from which a step is a jump where the views do not overlap; a quick turn is not."""
STEPS, QUICK_STEPS = 60, 6
"""Steps compared at most, the largest."""
JUMP_QUANTILE = 0.35
"""Of the differences, either way: after a large but true step up to this share of the points may be hidden."""
TOO_NEAR = 0.25
"""Share of the usual depth below which a view fills with one thing right before the camera, and tells nothing."""
OFF_CENTRE = 0.25
"""Share of the image's size by which a principal point may be off its centre."""

UNKNOWN = Agreement(np.nan, np.nan)

Pose = npt.NDArray[np.float64]
_Test = tuple[Hypothesis, Agreement]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that looks wrong."""

    kind: str
    """poses, depth-scale, intrinsics (joined by + where several), unreadable, jump, still, inconsistent, no-overlap."""
    text: str
    fix: str

    def __str__(self) -> str:
        return f"{self.text}; {self.fix}"


@dataclass(frozen=True, kw_only=True)
class SequenceCheck:
    """What `check_sequence` saw."""

    name: str
    format: str
    frames: int
    """Frames of the sequence, whatever the stride."""
    frames_read: int
    """Frames of which the images were read."""
    unreadable: Mapping[str, int]
    """Reason -> frames."""
    pairs: int
    """Pairs of frames compared."""
    agreement_cm: float
    """As given; infinite where neighbouring views do not overlap, NaN where nothing could be compared."""
    candidates: Mapping[str, float]
    """Other conventions tried -> agreement in cm."""
    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """Nothing was found."""
        return not self.findings


@dataclass(kw_only=True)
class _Look:
    """What was read of a sequence, and what is believed of it."""

    source: PosedSequence
    quick: bool
    poses: dict[int, Pose]
    """T_map_camera as given, of the frames that have one."""
    unreadable: Counter[str]
    views: dict[int, View] = field(default_factory=dict[int, View])
    read: set[int] = field(default_factory=set[int])
    bad: set[int] = field(default_factory=set[int])
    pairs: list[tuple[View, View]] = field(default_factory=list[tuple[View, View]])
    tried: dict[str, Agreement] = field(default_factory=dict[str, Agreement])
    given: Agreement = UNKNOWN
    best: Hypothesis
    best_agreement: Agreement = UNKNOWN


def check_sequence(source: PosedSequence, quick: bool = False) -> SequenceCheck:
    """Judge a sequence's poses, depth scale, intrinsics and files by reprojecting depths between frames.

    Parameters
    ----------
    source : PosedSequence
        Of `open_sequence`; its options are what "as given" means, but for the stride: neighbours are compared.
    quick : bool
        Read about 24 frames, and up to 12 where poses make their largest steps, instead of all.

    Raises
    ------
    BadFrameError
        A frame cannot be used and the input options say `strict`.
    """
    source = _unstrided(source)
    look = _read(source, quick)
    if look.pairs:
        _judge(look)
    found = (_conventions, _depth_range, _principal_point, _still, _inconsistent, _jumps, _unreadable)
    findings = tuple(finding for find in found for finding in find(look))
    return SequenceCheck(
        name=source.name,
        format=source.raw.format,
        frames=len(source),
        frames_read=len(look.read),
        unreadable=dict(look.unreadable),
        pairs=len(look.pairs),
        agreement_cm=look.given.cm,
        candidates={name: result.cm for name, result in look.tried.items()},
        findings=findings,
    )


def _unstrided(source: PosedSequence) -> PosedSequence:
    config = source.config
    frames = config.max_frames and config.max_frames * config.stride
    return PosedSequence(source.raw, config.model_copy(update={"stride": 1, "max_frames": frames}))


def _read(source: PosedSequence, quick: bool) -> _Look:
    look = _Look(source=source, quick=quick, poses={}, unreadable=Counter(), best=Hypothesis(config=source.config))
    for index in range(len(source)):
        try:
            look.poses[index] = source.pose(index)
        except BadFrameError as error:
            _count(look, index, error)
    chosen = partners(look.poses, QUICK_PAIRS if quick else PAIRS)
    kept = {index for pair in chosen for index in pair}
    for index in sorted(kept) if quick else range(len(source)):
        _look_at(look, index, keep=index in kept)
    look.pairs = [(look.views[a], look.views[b]) for a, b in chosen if a in look.views and b in look.views]
    return look


def _count(look: _Look, index: int, error: BadFrameError) -> None:
    if look.source.config.strict:
        raise error
    look.bad.add(index)
    look.unreadable[error.found] += 1


def _look_at(look: _Look, index: int, keep: bool) -> None:
    """Read a frame's images, and keep what comparisons need."""
    if index in look.views or index in look.bad:
        return
    try:
        frame = look.source.frame(index)
    except BadFrameError as error:
        _count(look, index, error)
        return
    look.read.add(index)
    if keep and (frame.depth > 0).any():
        look.views[index] = view(frame, *look.source.raw_pose(index))


def _judge(look: _Look) -> None:
    """The convention that the pairs agree with best; as given, unless another is clearly better and plausible."""
    camera = look.source.raw.color

    def test(hypotheses: Iterable[Hypothesis]) -> list[_Test]:
        return [(hypothesis, agreement(look.pairs, camera, hypothesis)) for hypothesis in hypotheses]

    singles = test(single_hypotheses(look.source))
    look.tried = {hypothesis.name: result for hypothesis, result in singles}
    look.given = look.best_agreement = agreement(look.pairs, camera, look.best)
    if look.given.share <= GOOD:
        return
    best = _clearly_better((look.best, look.given), singles)
    if best[0].kinds or look.given.share > PLAUSIBLE:
        best = _clearly_better(best, test(joint_hypotheses(look.source)))
    if best[1].share <= PLAUSIBLE:
        look.best, look.best_agreement = best


def _clearly_better(current: _Test, others: list[_Test]) -> _Test:
    best = min(others, key=lambda test: test[1].share)
    return best if best[1].share < CLEARLY * current[1].share else current


def _amount(result: Agreement, as_share: bool = False) -> str:
    return f"{100 * result.share:.1f} % of the depth" if as_share else f"{result.cm:.1f} cm"


def _conventions(look: _Look) -> Iterator[Finding]:
    best = look.best
    if best.kinds:
        as_share = "depth-scale" in best.kinds  # centimetres of two scales cannot be compared
        seen = (
            f"agreement {_amount(look.given, as_share)}" if np.isfinite(look.given.cm) else "views that do not overlap"
        )
        text = f"{best.claim}: {seen} as given, {_amount(look.best_agreement, as_share)} {best.name}"
        yield Finding(kind="+".join(best.kinds), text=text, fix=best.fix)


def _depth_range(look: _Look) -> Iterator[Finding]:
    """Without translation a wrong scale cannot be seen in reprojection, but depths of kilometres can."""
    median = float(np.median([each.median_depth for each in look.views.values()])) if look.views else 1.0
    if "depth-scale" in look.best.kinds or SANE_DEPTH[0] <= median <= SANE_DEPTH[1]:
        return
    units = median * look.source.depth_scale
    fits = [scale for scale in DEPTH_SCALES if SANE_DEPTH[0] <= units / scale <= SANE_DEPTH[1]]
    fix = f"use --depth-scale {fits[0]:g}" if fits else "name the units a metre with --depth-scale"
    text = f"depth scale looks wrong: the median depth is {median:.3g} m at {look.source.depth_scale:g} units a metre"
    yield Finding(kind="depth-scale", text=text, fix=fix)


def _principal_point(look: _Look) -> Iterator[Finding]:
    camera = look.source.raw.color
    off = max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
    if off > OFF_CENTRE and "intrinsics" not in look.best.kinds:
        centre, size = f"({camera.cx:.0f}, {camera.cy:.0f})", f"{camera.width}x{camera.height}"
        text = f"intrinsics look made for another resolution: principal point {centre} in {size} images"
        yield Finding(kind="intrinsics", text=text, fix=f"correct {look.source.raw.intrinsics_source}")


def _is_still(look: _Look) -> bool:
    poses = np.array(list(look.poses.values()))
    return len(poses) > 1 and bool(np.abs(poses - poses[0]).max() < 1e-6)


def _still(look: _Look) -> Iterator[Finding]:
    """A camera on a tripod has one pose too, but then its depth images agree."""
    if _is_still(look) and look.pairs and look.given.share > PLAUSIBLE / 2:
        text = f"all poses are the same, but the view changes: agreement {_amount(look.given)}"
        yield Finding(kind="still", text=text, fix="give each frame its pose")


def _inconsistent(look: _Look) -> Iterator[Finding]:
    if not look.pairs or look.best.kinds or look.given.share <= PLAUSIBLE or _is_still(look):
        return
    if np.isfinite(look.given.cm):
        text = (
            f"depths predicted into neighbouring frames are {_amount(look.given)} off, and no usual mistake explains it"
        )
        fix = "check that images and poses belong together, the intrinsics and the depth scale"
        yield Finding(kind="inconsistent", text=text, fix=fix)
    else:
        text = "most neighbouring views do not overlap: the frames are too far apart, or the poses are wrong"
        yield Finding(kind="no-overlap", text=text, fix="use more frames of the recording, or check the poses")


def _jumps(look: _Look) -> Iterator[Finding]:
    """Large steps between neighbours that the images do not follow; only where most of the poses are right."""
    if not look.best_agreement.share <= PLAUSIBLE:
        return
    suspects = _large_steps(look)[: QUICK_STEPS if look.quick else STEPS]
    bad = sorted((step for step in suspects if _breaks(look, step)), key=lambda step: step.a)
    if bad:
        first = bad[0]
        at = f"between frames {look.views[first.a].index} and {look.views[first.b].index}"
        count = f"{len(bad)} pose jumps, the first" if len(bad) > 1 else "a pose jump"
        size = f"{first.distance:.2f} m and {np.rad2deg(first.angle):.0f} degrees"
        text = f"{count} {at} by {size}, which the images do not follow"
        yield Finding(kind="jump", text=text, fix="correct or remove these poses, or split the sequence there")


@dataclass(frozen=True)
class _Step:
    a: int
    b: int
    distance: float
    """Metres."""
    angle: float
    """Radians."""
    ratio: float
    """To the median step, the larger of the two."""


def _large_steps(look: _Look) -> list[_Step]:
    """Steps above the median between neighbours, the largest first; poses by the convention believed."""
    order = np.array(sorted(look.poses))
    if len(order) < 4:
        return []
    poses = [pose_matrix(*look.source.raw_pose(int(index)), look.best.config) for index in order]
    relative = [invert(a) @ b for a, b in pairwise(poses)]
    distance = np.array([np.linalg.norm(T[:3, 3]) for T in relative])
    angle = np.array([rotation_angle(T) for T in relative])
    ratio = np.zeros(len(relative))
    for amount, least in ((distance / np.diff(order), MIN_JUMP), (angle / np.diff(order), MIN_TURN)):
        share = amount / max(float(np.median(amount)), 1e-9)
        ratio = np.maximum(ratio, np.where(amount > least, share, 0))
    chosen = [i for i in np.argsort(-ratio) if ratio[i] > STEP_RATIO]
    return [
        _Step(int(order[i]), int(order[i + 1]), float(distance[i]), float(angle[i]), float(ratio[i])) for i in chosen
    ]


def _breaks(look: _Look, step: _Step) -> bool:
    for index in (step.a, step.b):
        _look_at(look, index, keep=True)
    if step.a not in look.views or step.b not in look.views:
        return False
    a, b = look.views[step.a], look.views[step.b]
    if min(a.median_depth, b.median_depth) < TOO_NEAR * np.median([each.median_depth for each in look.views.values()]):
        return False
    there, back = (
        pair_agreement(*views, look.source.raw.color, look.best, JUMP_QUANTILE).share for views in ((a, b), (b, a))
    )
    apart = not (np.isfinite(there) and np.isfinite(back))
    return step.ratio > JUMP_RATIO if apart else min(there, back) > PLAUSIBLE


def _unreadable(look: _Look) -> Iterator[Finding]:
    if look.unreadable:
        reasons = ", ".join(f"{count} with {reason}" for reason, count in look.unreadable.most_common())
        text = f"{look.unreadable.total()} of {len(look.source)} frames cannot be used: {reasons}"
        yield Finding(kind="unreadable", text=text, fix="restore them; `uppm map` skips them, unless --strict")
