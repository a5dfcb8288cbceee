"""What the navigation solution may claim about itself."""

from enum import StrEnum


class Mode(StrEnum):
    """State of the fused solution; outputs must not claim more than this says."""

    INVALID = "invalid"
    """No solution: before the first inertial data, or while re-aligning."""
    ALIGNING = "aligning"
    """Running, but no acoustic fix has been used yet."""
    AIDED = "aided"
    """A fix was used within ``max_fix_age_s``."""
    DEAD_RECKONING = "dead_reckoning"
    """Inertial only: no fix used for longer than ``max_fix_age_s``."""
    FAULT = "fault"
    """The filter's covariance or state failed; it starts again by itself."""
