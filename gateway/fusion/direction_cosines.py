"""Direction of a beacon by the time differences between an array's elements, where there is one.

Seed 002: sound that reaches two elements a baseline d apart with the difference tau comes at
``cos = c tau / d`` to that baseline. Two baselines at right angles give a direction only if the
squares of their cosines sum to at most one; noise, a wrong sound speed or an echo break that, and
then the fix is not valid while the Doppler of the same sound still is.  # (M.89)
"""

import math
from typing import NamedTuple


class Baselines(NamedTuple):
    """Distances (m) of the elements along the array's x (forward) and y (starboard) axes."""

    x: float
    y: float


class Delays(NamedTuple):
    """Time differences (s), positive where the forward (starboard) element hears first."""

    x: float
    y: float


class Direction(NamedTuple):
    """Elevation (up) and bearing (to starboard) in array axes, rad."""

    elevation: float
    bearing: float


def direction(
    delays: Delays, baselines: Baselines, sound_speed: float, *, below: bool = True
) -> Direction | None:
    """Direction of a beacon; None where the time differences contradict each other.

    Parameters
    ----------
    sound_speed
        At the array (m/s).
    below
        Which of the two directions that the plane of the array allows: down, for a beacon on the
        sea bed, or up, for a buoy above an array that looks to the surface.
    """
    cos_x = sound_speed * delays.x / baselines.x
    cos_y = sound_speed * delays.y / baselines.y
    square = cos_x * cos_x + cos_y * cos_y
    if not square <= 1.0:  # NaN, too
        return None
    depression = math.acos(math.sqrt(square))
    return Direction(-depression if below else depression, math.atan2(cos_y, cos_x))


def in_range(slant_range: float, shortest: float, longest: float) -> bool:
    """Whether a slant range (m) is one that the instrument can have measured."""
    return shortest <= slant_range <= longest
