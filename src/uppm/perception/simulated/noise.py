"""What the simulated perception makes of one frame, before any pixel is touched.

Every draw depends on the seed, the frame's index and the instance alone, so that a run that is resumed, or that uses
other frames, sees the same. Draws that are held belong to an episode of `hold` frames, which begins at another frame
for each instance. A rate is compared with a draw of its own: raising one leaves the others' events as they are, and
keeps its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from uppm.core.config import SimulatedConfig
from uppm.core.types import Frame, GroundTruth
from uppm.perception.simulated.names import Names, name_table, names_of

SMALL = 32 * 32
"""Pixels below which an object is missed twice as often (COCO's small objects)."""
BLUR_FACTOR = 2.0
"""A blurred frame's noise is of so many times the level."""
SCORE, WRONG_SCORE, SCORE_DEVIATION = 0.6, 0.5, 0.12
"""Mean score of a right call and of a wrong one, and their deviation."""
LOOSE = 0.3
"""Share of second boxes that lie anywhere within `box_jitter`; the others are the first within a pixel."""
_HELD, _OWN, _WHOLE = range(3)
"""Streams of draws: of an episode, of one instance in one frame, of a frame."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxNoise:
    """Of one box and its mask."""

    jitter: npt.NDArray[np.float64]
    """(4,): of x0, y0, x1, y1, as a share of the box's size."""
    shift: npt.NDArray[np.float64]
    """(4,): likewise, pixels."""
    grow: float
    """Pixels by which the mask is dilated, or eroded where it is negative."""
    score: float


@dataclass(frozen=True, kw_only=True, eq=False)
class InstanceNoise:
    """What becomes of one visible instance."""

    instance: int
    truth: str
    """Its name in `labels.csv`."""
    is_thing: bool
    name: str
    """What it is called."""
    other_name: str
    """What it is called the second time, where it has a second box."""
    tag: str
    wrong: bool
    in_caption: bool
    in_tags: bool
    missed: bool
    split: float | None
    """Angle of the cut, radians."""
    merged: bool
    duplicated: bool
    part: npt.NDArray[np.float64] | None
    """(4,): x0, y0, x1, y1 of the box inside, from 0 to 1 across its own."""
    boxes: tuple[BoxNoise, BoxNoise, BoxNoise]
    """Of the first, the second, and the one inside."""


@dataclass(frozen=True, kw_only=True)
class FalseTag:
    """A tag for what is not there, and where the detector finds it after all."""

    name: str
    center: tuple[float, float]
    """Column and row, from 0 to 1."""
    size: float
    """Of the box, as a share of the image's."""
    score: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameNoise:
    """What becomes of one frame."""

    blurred: bool
    flagged: bool
    """The caption says that it is blurred."""
    angle: float
    """Direction of the blur, radians."""
    instances: tuple[InstanceNoise, ...]
    """Largest first, things before stuff."""
    false_tags: tuple[FalseTag, ...]


def frame_noise(frame: Frame, truth: GroundTruth, config: SimulatedConfig) -> FrameNoise:
    """Draw what becomes of a frame."""
    pixels = np.bincount(truth.instance.ravel())
    seen = [n for n in truth.names if 0 < n < len(pixels) and pixels[n]]
    blur = blur_noise(frame.index, config)
    level = config.level * (BLUR_FACTOR if blur.blurred else 1.0)
    noisy = config.model_copy(update={"level": level})
    instances = [_instance_noise(n, truth, int(pixels[n]), frame, noisy) for n in seen]
    instances.sort(key=lambda i: (not i.is_thing, -pixels[i.instance], i.instance))
    return replace(blur, instances=tuple(instances), false_tags=_false_tags(frame.index, truth, seen, noisy))


def blur_noise(index: int, config: SimulatedConfig) -> FrameNoise:
    """The part that is known without looking at the frame."""
    draws = _draws(config, _WHOLE, index)
    blurred = bool(draws[0] < _rate(config.blurred, config))
    flagged = blurred and bool(draws[1] >= _rate(config.unflagged, config))
    return FrameNoise(blurred=blurred, flagged=flagged, angle=float(np.pi * draws[2]), instances=(), false_tags=())


def _rate(rate: float, config: SimulatedConfig) -> float:
    return rate * config.level


def _draws(config: SimulatedConfig, *key: int) -> npt.NDArray[np.float64]:
    return np.random.default_rng((config.seed, *key)).random(16)


def _instance_noise(
    number: int, truth: GroundTruth, pixels: int, frame: Frame, config: SimulatedConfig
) -> InstanceNoise:
    name, thing = truth.names[number], number in truth.things
    # A prime spreads the episodes' beginnings, so that not all objects change their names in one frame.
    u = _draws(config, _HELD, number, (frame.index + 7919 * number) // config.hold)
    known = names_of(name)
    wrong = bool(known.near) and bool(u[0] < _rate(config.wrong, config))
    synonym = _rate(config.synonym, config)
    called = known.near[int(u[1] * len(known.near))] if wrong else _call(known, synonym, u[2], u[3])
    others = [other for other in known.names if other != called] or [called]
    inside = (u[13] < _rate(config.part, config)) and thing
    return InstanceNoise(
        instance=number,
        truth=name,
        is_thing=thing,
        name=called,
        other_name=others[int(u[4] * len(others))],
        tag=called if wrong else _call(known, synonym, u[5], u[6]),
        wrong=wrong,
        in_caption=bool(u[7] >= _rate(config.unmentioned, config)),
        in_tags=bool(u[8] >= _rate(config.untagged, config)),
        missed=bool(u[9] < _rate(config.missed, config) * (2 if pixels < SMALL else 1)),
        split=float(np.pi * u[14]) if thing and u[10] < _rate(config.split, config) else None,
        merged=thing and bool(u[11] < _rate(config.merged, config)),
        duplicated=thing and bool(u[12] < _rate(config.duplicated, config)),
        part=_inner_box(u[14], u[15]) if inside else None,
        boxes=_box_noises(number, frame, config, wrong=wrong),
    )


def _call(known: Names, synonym: float, other: float, which: float) -> str:
    """A right name: another than the first where the draw `other` is below the rate."""
    if len(known.names) == 1 or other >= synonym:
        return known.names[0]
    return known.names[1 + int(which * (len(known.names) - 1))]


def _inner_box(first: float, second: float) -> npt.NDArray[np.float64]:
    """A box of 0.4 to 0.8 of the sides, somewhere inside."""
    size = 0.4 + 0.4 * first
    corner = (1 - size) * np.array([second, (second * 97) % 1])
    return np.concatenate([corner, corner + size])


def _box_noises(
    number: int, frame: Frame, config: SimulatedConfig, *, wrong: bool
) -> tuple[BoxNoise, BoxNoise, BoxNoise]:
    rng = np.random.default_rng((config.seed, _OWN, number, frame.index))
    normal, uniform = rng.standard_normal((3, 5)), rng.uniform(-1, 1, (3, 5))
    mean, scale = WRONG_SCORE if wrong else SCORE, config.level * frame.intrinsics.width / 640
    drawn = np.clip(mean + SCORE_DEVIATION * normal[:, 4], 0.3, 0.95)
    scores = (1 - min(config.level, 1.0) * (1 - drawn)).tolist()
    grow = (uniform[:, 4] * config.mask_pixels * scale).tolist()
    jitter, shift = normal[:, :4] * config.box_jitter * config.level, np.zeros((3, 4))
    if rng.random() >= LOOSE:
        jitter[1], shift[1] = jitter[0], uniform[1, :4] * config.level
    first, second, inner = (BoxNoise(jitter=jitter[k], shift=shift[k], grow=grow[k], score=scores[k]) for k in range(3))
    return first, second, inner


def _false_tags(index: int, truth: GroundTruth, seen: list[int], config: SimulatedConfig) -> tuple[FalseTag, ...]:
    rng = np.random.default_rng((config.seed, _WHOLE, index, 1))
    count = int(rng.poisson(_rate(config.false_tags, config)))
    absent = sorted(set(name_table()) - {truth.names[n] for n in seen}) if count else []
    return tuple(
        FalseTag(
            name=absent[rng.integers(len(absent))],
            center=(float(rng.random()), float(rng.random())),
            size=float(rng.uniform(0.05, 0.2)),
            score=float(np.clip(rng.normal(WRONG_SCORE, SCORE_DEVIATION), 0.3, 0.95)),
        )
        for _ in range(count)
    )
