"""Sentences of a satellite receiver to positions and velocities, each at its epoch."""

import math

from msgspec import UNSET

from drivers.records import GnssRecord, Measured, Record, Rejected, TimeRecord
from gateway.config import GnssDevice
from gateway.ingest.device import FixIngest
from gateway.messages import PositionFix, Vec3, VelocityFix

EPOCH_NS = 1_000_000_000
"""Sentences of the same second of the day are of one epoch if they come within this."""
BURST_NS = 50_000_000
"""A sentence without a time is of the epoch whose last sentence it follows within this."""
DAY_MS = 86_400_000


class GnssIngest(FixIngest):
    """Positions of GGA or GNS, velocities of RMC or VTG: of each pair the one heard first.

    All sentences of an epoch hold for the moment of the first one: the others only wait for the
    line. RMC's position is that of GGA once more and would count twice, as the other of a pair
    would.
    """

    def __init__(self, name: str, device: GnssDevice) -> None:
        super().__init__(device)
        self._name = name
        self._sd_position = device.noise.position_m
        self._sd_velocity = (device.noise.velocity_m_s,) * 3
        self._epoch_ms: int | None = None
        self._epoch_ns = self._first_ns = self._last_ns = 0
        self._sources: dict[str, str | None] = {}

    def take(self, record: Record | Rejected) -> None:
        """Take the next record; one that is invalid or neither position nor velocity counts."""
        if not self._count(record):
            return
        if isinstance(record, TimeRecord):
            self._of_epoch_ns(record, record.unix_s)
            self.counts.ignored["time"] += 1
            return
        if not isinstance(record, GnssRecord):
            self.counts.ignored["not_gnss"] += 1
            return
        t_ns = self._of_epoch_ns(record, record.t_device_s)
        quantity = "velocity" if record.sentence in ("RMC", "VTG") else "position"
        if not record.valid:
            self.counts.ignored["invalid"] += 1
        elif self._sources.setdefault(quantity, record.sentence) != record.sentence:
            self.counts.ignored["repeated"] += 1
        elif quantity == "position":
            self._take_position(record, t_ns)
        else:
            self._take_velocity(record, t_ns)

    def _of_epoch_ns(self, record: Measured, t_device_s: float | None) -> int:
        """When the record's epoch was, by the first sentence that told of it."""
        t_ns = self._left_instrument_ns(record)
        epoch_ms = None if t_device_s is None else round(1e3 * t_device_s) % DAY_MS
        if epoch_ms is None:
            same = abs(t_ns - self._last_ns) < BURST_NS
        else:
            same = epoch_ms == self._epoch_ms and abs(t_ns - self._first_ns) < EPOCH_NS
        if not same:
            self._epoch_ms, self._first_ns = epoch_ms, t_ns
            self._epoch_ns = self._valid_at_ns(record, t_device_s)
        self._last_ns = t_ns
        return self._epoch_ns

    def _take_position(self, record: GnssRecord, t_ns: int) -> None:
        if record.lat_deg is None or record.lon_deg is None:
            self.counts.ignored["no_position"] += 1
            return
        lat, lon = math.radians(record.lat_deg), math.radians(record.lon_deg)
        self._fixes.append(
            PositionFix(t_ns, self._name, lat, lon, record.height_m, self._sd_of(record))
        )

    def _sd_of(self, record: GnssRecord) -> Vec3:
        """As configured, or as the receiver tells where that is worse."""
        a, b, c = self._sd_position
        if record.sd_m is UNSET:
            return a, b, c
        north, east, down = record.sd_m
        return max(a, north), max(b, east), max(c, down)

    def _take_velocity(self, record: GnssRecord, t_ns: int) -> None:
        """A receiver at rest may leave the course empty: then there is no direction."""
        speed, course = record.speed_m_s, record.course_deg
        if speed is None or course is None:
            self.counts.ignored["no_course"] += 1
            return
        north = speed * math.cos(math.radians(course))
        east = speed * math.sin(math.radians(course))
        self._fixes.append(VelocityFix(t_ns, self._name, north, east, None, self._sd_velocity))
