"""What the innovations say of the measurements: weights, quality of beacons, noise of devices.

Weights
    An innovation that is unlikely weighs less: its noise is multiplied by `inflation`, a function
    of its normalised square. Huber's leaves what is likely alone and takes the influence of the
    rest as constant; Student's t is the expectation step of noise with heavy tails. Both only ever
    lower a weight, and the chi-squared gate stands beside them.  # (M.85), (M.86)
Quality
    Running mean of the normalised square over its degrees of freedom for each beacon: near one for
    a beacon that sounds as declared.  # (M.87)
Noise
    Running estimate of each row's variance over the declared one, by the innovations less what the
    state's own uncertainty explains.  # (M.88)
"""

import math
from typing import Literal

import numpy as np
import scipy.special
from numpy.typing import NDArray

from gateway.fusion.kalman import Linearised

Array = NDArray[np.float64]
Kind = Literal["none", "huber", "student_t"]

HUBER_LIKELY = 0.95
"""Probability of the innovations that Huber's weight leaves alone."""
STUDENT_DOF = 4.0
"""Degrees of freedom of Student's t: the fewer, the heavier the tails."""

QUALITY_FIXES = 20
"""Fixes over which a beacon's quality is a mean."""
QUALITY_MAX = 100.0
"""What one fix counts for at most: a beacon may recover."""

NOISE_FIXES = 40
"""Fixes over which a device's noise is a mean, where they tell of nothing but noise."""
NOISE_BOUNDS = (1.0 / 9.0, 9.0)
"""Bounds of the variance's factor: a third and three times the declared sigma."""


def inflation(kind: Kind, nis: float, rows: int) -> float:
    """Factor (>= 1) on the noise of a measurement of `rows` rows.  # (M.85), (M.86)"""
    match kind:
        case "none":
            return 1.0
        case "huber":
            likely = float(scipy.special.chdtri(rows, 1.0 - HUBER_LIKELY))
            return max(1.0, math.sqrt(nis / likely))
        case "student_t":
            return max(1.0, (STUDENT_DOF + nis) / (STUDENT_DOF + rows))


def updated_quality(before: tuple[int, float], nis: float, rows: int) -> tuple[int, float]:
    """Fixes heard (saturating) and their mean NIS per row, one fix later.  # (M.87)"""
    count, mean = before
    count = min(count + 1, QUALITY_FIXES)
    return count, mean + (min(nis / rows, QUALITY_MAX) - mean) / count


def noise_key(device: str, name: str) -> str:
    """Name of the noise of a device's rows of one kind."""
    return f"{device}/{name}"


def rescaled(z: Linearised, device: str, noise: dict[str, float]) -> Linearised:
    """The measurement with the noise that its device has shown."""
    if not noise:
        return z
    d = np.sqrt([noise.get(noise_key(device, name), 1.0) for name in z.names])
    return Linearised(z.residual, z.H, z.R * np.outer(d, d), z.names)


def learn_noise(noise: dict[str, float], device: str, z: Linearised, S: Array) -> None:
    """Take an innovation of covariance `S` into the noise of a device, in place.  # (M.88)

    `z` comes with the noise as known so far. Where the state is less certain than the measurement
    the innovation says little about the noise, and counts little.
    """
    for name, nu, s, r in zip(z.names, z.residual, S.diagonal(), z.R.diagonal(), strict=True):
        key = noise_key(device, name)
        scale = noise.get(key, 1.0)
        seen = scale * (nu * nu - (s - r)) / r
        share = (r / s) ** 2 / NOISE_FIXES
        low, high = NOISE_BOUNDS
        noise[key] = float(min(high, max(low, scale + share * (seen - scale))))
