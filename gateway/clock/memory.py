"""What outlives a clock's process, and what is left of it after a time in which nobody listened."""

from math import hypot, inf

import msgspec

from gateway.clock.envelope import WINDOW, Before, EnvelopeMemory

DRIFT_AGAIN = 3e-6
"""How much a power cycle may change a drift."""
LATE_STRETCHES = 5
"""Stretches far above the envelope after which it is taken to have moved."""
OUTAGE_S = 1.0
"""Silence after which a count that turns over quickly says nothing any more."""
QUICK_S = 60.0
"""A turn shorter than this is quick."""
ABSENCE_S = WINDOW
"""Longer than this nothing of an offset outlives its process: what it rests on is older."""


class Placed(msgspec.Struct, frozen=True, array_like=True):
    """Where a locked clock has the device's count, see `gateway.clock.DeviceClock`."""

    origin_ns: int
    t_last_ns: int
    first: int
    last: int
    due_s: float
    lag_s: float
    envelope: EnvelopeMemory


class ClockMemory(msgspec.Struct, frozen=True, array_like=True):
    """A clock as it outlives its process.

    ``before`` is what is believed where the count begins anew: its drift and jitter, the device's
    own and the line's; ``placed`` is None where no more than that is known.
    """

    unit_s: float
    modulus: int
    before: Before
    queue_s: float
    placed: Placed | None = None


Clocks = dict[str, dict[str, ClockMemory]]
"""The clocks of each device, by what they go by."""


def aged(memory: ClockMemory, now_ns: int | None) -> ClockMemory:
    """What is left of a clock after a time in which nobody listened.  # (M.179)

    The drift always; the offset while that time is short and the count does not turn over quickly:
    the first arrivals then show whether it still holds, one late stretch being enough.

    Parameters
    ----------
    now_ns
        Host's monotonic time now; None where that began anew, with the machine.
    """
    placed = memory.placed
    if placed is None:
        return memory
    is_quick = memory.modulus * memory.unit_s < QUICK_S
    away_s = inf if now_ns is None else (now_ns - placed.t_last_ns) * 1e-9
    if away_s > (OUTAGE_S if is_quick else ABSENCE_S):
        return msgspec.structs.replace(memory, placed=None)
    line = placed.envelope.line
    sigma = hypot(line.sigma or 0.0, DRIFT_AGAIN * away_s)
    envelope = placed.envelope._replace(
        line=line._replace(sigma=sigma), late=LATE_STRETCHES - 1, end=None, least=(0.0, inf)
    )
    return msgspec.structs.replace(
        memory, placed=msgspec.structs.replace(placed, envelope=envelope)
    )
