"""A structured-light sensor, modelled on exact depth: for tests and benchmarks on rendered sequences.

Three of its faults, in this order: it does not see what its projector does not light, it mixes neighbouring pixels, and
its depth is the less certain the farther away, with the square of the depth. Faults of pixels are independent, which
those of a real sensor are not quite.

References
----------
Khoshelham, Elberink: Accuracy and Resolution of Kinect Depth Data for Indoor Mapping Applications. Sensors 12 (2012).
Nguyen, Izadi, Lovell: Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking. 3DIMPVT (2012).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Depth = npt.NDArray[np.float32]

AXIAL = 1.425e-3
"""Standard deviation of depth over the squared depth, metres (Khoshelham and Elberink: half a step of disparity):
1.4 mm at 1 m, 3.6 cm at 5 m."""
LATERAL = 0.8
"""Standard deviation of a measurement's place in the image, pixels of 640 columns (Nguyen et al., facing a surface)."""
COLUMNS = 640
BASELINE = 0.075
"""Metres between projector and camera (Khoshelham and Elberink)."""
STEP = 0.5
"""Pixels by which another surface must stand in the projector's way: depth images are rounded."""


def structured_light(depth: Depth, fx: float, seed: int, frame: int) -> Depth:
    """Depth (H, W) as such a sensor would measure it, metres; 0: no measurement.

    Parameters
    ----------
    depth : (H, W) float32
        Exact depth, metres; 0 where there is none.
    fx : float
        Focal length, pixels.
    seed, frame : int
        The same pair gives the same noise, in any order of frames.
    """
    rng = np.random.default_rng((seed, frame))
    lit = np.where(in_shadow(depth, fx), np.float32(0), depth)
    moved = _moved(lit, LATERAL * depth.shape[1] / COLUMNS, rng)
    noise = rng.standard_normal(depth.shape, dtype=np.float32) * np.float32(AXIAL) * moved**2
    # At 5 m a standard deviation is under 1 % of the depth: no measurement comes out at 0 or below.
    return np.where(moved > 0, moved + noise, np.float32(0))


def in_shadow(depth: Depth, fx: float) -> npt.NDArray[np.bool_]:
    """Pixels (H, W) that the projector, to the camera's right, does not light: something nearer stands in its way.

    Of two points of one row, the one farther left in the camera's image is farther left in the projector's too, unless
    the one on the right is nearer and hides it there.
    """
    with np.errstate(divide="ignore"):
        column = np.arange(depth.shape[1]) - np.where(depth > 0, fx * BASELINE / depth, -np.inf)
    hidden_from = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    return (depth > 0) & (column > hidden_from + STEP)


def _moved(depth: Depth, sigma: float, rng: np.random.Generator) -> Depth:
    """Each pixel with the depth of one beside it, or its own."""
    rows, columns = np.indices(depth.shape)
    shift = np.rint(rng.standard_normal((2, *depth.shape), dtype=np.float32) * np.float32(sigma)).astype(np.intp)
    rows = np.clip(rows + shift[0], 0, depth.shape[0] - 1)
    return depth[rows, np.clip(columns + shift[1], 0, depth.shape[1] - 1)]
