"""From a line's bytes to measurements: sensor axes to body, SI units, time of validity.

Time of validity = arrival of the frame's first byte - serial line time - declared latency. Where
the device counts or tells the time, that sets the arrivals right (`gateway.clock`): frames that
shared a chunk spread out, a missing one shows.
"""

from gateway.ingest.device import DeviceCounts
from gateway.ingest.intake import Ingest, Intake, intakes

__all__ = ["DeviceCounts", "Ingest", "Intake", "intakes"]
