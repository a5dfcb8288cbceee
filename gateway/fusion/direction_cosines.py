"""Direction of a beacon by the time differences between an array's elements, where there is one.

Seed 002: sound that reaches two elements a baseline d apart with the difference tau comes at
``cos = c tau / d`` to that baseline. Baselines in a plane give a direction only if the squares of
its cosines sum to at most one; noise, a wrong sound speed or an echo break that, and then the fix
is not valid while the Doppler of the same sound still is.  # (M.89)
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Direction(NamedTuple):
    """Elevation (up) and bearing (to starboard) in array axes, rad."""

    elevation: float
    bearing: float


def direction(
    baselines: Array, delays: Array, sound_speed: float, *, below: bool = True
) -> Direction | None:
    """Direction of a beacon; None where the time differences contradict each other.

    Parameters
    ----------
    baselines
        (n, 2) forward and starboard, from one element to another (m).
    delays
        (n,) how much later the other one hears (s).
    sound_speed
        At the array (m/s).
    below
        Which of the two directions that the plane of the array allows: down, for a beacon on the
        sea bed, or up, for a buoy above an array that looks to the surface.
    """
    if not np.isfinite(delays).all():
        return None
    cosines, _, rank, _ = np.linalg.lstsq(baselines, -sound_speed * delays, rcond=None)
    square = float(cosines @ cosines)
    if rank < 2 or square > 1.0:
        return None
    depression = math.acos(math.sqrt(square))
    bearing = math.atan2(float(cosines[1]), float(cosines[0]))
    return Direction(-depression if below else depression, bearing)


def in_range(slant_range: float, shortest: float, longest: float) -> bool:
    """Whether a slant range (m) is one that the instrument can have measured."""
    return shortest <= slant_range <= longest
