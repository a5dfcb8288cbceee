"""What the navigation solution may claim about itself."""

import math
from enum import StrEnum

KNOWN_HEADING_SD = math.radians(5.0)
"""A heading known worse is nothing to go by."""


class Mode(StrEnum):
    """State of the fused solution; outputs must not claim more than this says."""

    INVALID = "invalid"
    """No solution: before the first inertial data, or while re-aligning."""
    ALIGNING = "aligning"
    """Running, but nothing has been used yet, or the heading is known worse than 5 deg: then
    neither sights of a beacon nor dead reckoning tell a place, however young the last fix is. Nor
    is a place told while what the IMU feels cannot be (`gateway.fusion.credible`)."""
    AIDED = "aided"
    """A fix that gives a place was used within ``max_fix_age_s``."""
    DEAD_RECKONING = "dead_reckoning"
    """None for longer, or none yet: from the last place, or from ``initial``, by what else there is
    (a Doppler log, a compass, the IMU)."""
    FAULT = "fault"
    """The filter's covariance or state failed; it starts again by itself."""


PLACED = (Mode.AIDED, Mode.DEAD_RECKONING)
"""Those that claim a place."""


def claimable(mode: Mode, heading_sd: float) -> Mode:
    """The mode that fixes allow, or less where the heading's 1-sigma (rad) does not allow it."""
    return Mode.ALIGNING if mode in PLACED and not heading_sd <= KNOWN_HEADING_SD else mode
