"""When it was, by the host: the counts and pulses of devices, and Unix time of monotonic moments.

A `device` counts by a quartz of its own and is heard late, by queues: the lower `envelope` of the
delays tells its offset and drift. A `pulse` says when its seconds begin.
"""

from gateway.clock.device import NEVER, DeviceClock, Tick
from gateway.clock.memory import ClockMemory, Clocks, aged
from gateway.clock.report import ClockReport, Source

__all__ = [
    "NEVER",
    "ClockMemory",
    "ClockReport",
    "Clocks",
    "DeviceClock",
    "Source",
    "Tick",
    "aged",
]
