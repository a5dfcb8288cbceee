"""What one device's clock says of itself: what it goes by, and how surely."""

from typing import Literal

import msgspec

State = Literal["silent", "warming", "locked"]
Source = Literal["pulse", "time", "sequence", "frames", "arrival"]


class ClockReport(msgspec.Struct, frozen=True):
    """What one device's clock says of itself.

    ``source`` is what its times rest on: the ``pulse`` of its seconds, the ``time`` or ``sequence``
    that frames carry, the ``frames`` counted as they come, or the ``arrival`` of each, whose
    queueing nobody can tell.
    """

    source: Source
    state: State | None
    """None where every time is that of its arrival."""
    offset_s: float | None = None
    """Host's monotonic time at which the device's count was zero."""
    drift_ppm: float | None = None
    """By how much the device's seconds are longer than the host's."""
    sigma_ms: float | None = None
    """1 sigma of a time of validity, the declared latency taken as exact; None where unknown."""
    jitter_ms: float | None = None
    """Mean delay of the quickest arrivals, one a second, above the envelope."""
    resets: int = 0
    """How often the count, or the host's time with it, began anew."""
    untimed: int = 0
    """Records without the time they should carry, placed by their arrival."""
