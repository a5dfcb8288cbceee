"""What the navigation solution may claim about itself."""

from enum import StrEnum


class Mode(StrEnum):
    """State of the fused solution; outputs must not claim more than this says."""

    INVALID = "invalid"
    """No solution: before the first inertial data, or while re-aligning."""
    ALIGNING = "aligning"
    """Running, but nothing has been used yet, or the heading is known worse than 5 deg."""
    AIDED = "aided"
    """A fix that gives a place was used within ``max_fix_age_s``."""
    DEAD_RECKONING = "dead_reckoning"
    """None for longer, or none yet: from the last place, or from ``initial``, by what else there is
    (a Doppler log, a compass, the IMU)."""
    FAULT = "fault"
    """The filter's covariance or state failed; it starts again by itself."""
