"""What every device's ingest has in common: counting, and when a frame was true."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from msgspec import UNSET

from drivers.records import Measured, Record, Rejected
from drivers.settings import SerialLink
from gateway.clock import ClockMemory, ClockReport, DeviceClock
from gateway.clock.pulse import DAY_MS, PulsedClock
from gateway.config import Device
from gateway.messages import Measurement

NO_PAUSE_NS = 20_000_000
"""Bytes that follow within this follow at once, as far as stamps can tell."""
UNORDERED_S = 1.0
"""How far behind the newest the time of a sentence may be, for not all are sent in their order."""


@dataclass
class DeviceCounts:
    """What became of a device's bytes."""

    bytes: int = 0
    records: int = 0
    measurements: int = 0
    gaps: int = 0
    missing: int = 0
    ignored: Counter[str] = field(default_factory=Counter)
    rejected: Counter[str] = field(default_factory=Counter)
    rejected_bytes: int = 0


class DeviceIngest:
    """Counting and time of validity, common to all kinds."""

    def __init__(self, device: Device) -> None:
        link = device.link
        self.counts = DeviceCounts()
        self._latency_ns = round(device.clock.latency_ms * 1e6)
        self._byte_ns = 0.0
        if isinstance(link, SerialLink):
            self._byte_ns = link.bits_per_byte * 1e9 / link.baud
        self._wants_device_time = device.clock.source != "arrival"
        told = DeviceClock(1e-3, DAY_MS, UNORDERED_S)
        self._day = PulsedClock(told) if self._wants_device_time else None
        self._untimed = 0
        self._garbled_ns = self._garbled_until_ns = 0

    def end_of_chunk(self) -> None:
        """Nothing more came with the records taken so far."""

    def learn(self) -> None:
        """Learn how to place what comes next from what came."""
        if self._day is not None:
            self._day.learn()

    def pulse(self, t_ns: int) -> None:
        """Take the moment at which a second of the device began."""
        if self._day is not None:
            self._day.pulse(t_ns)

    def clock_report(self) -> ClockReport:
        """How the device's measurements are placed in time."""
        if self._day is None:
            return ClockReport("arrival", None)
        return self._day.report(self._untimed)

    def clock_memory(self) -> dict[str, ClockMemory]:
        """What outlives this process of how they are placed, by what that goes by."""
        return {} if self._day is None else self._day.memory()

    def resume(self, clocks: Mapping[str, ClockMemory]) -> None:
        """Go on from what an earlier process knew."""
        if self._day is not None:
            self._day.resume(clocks)

    def _count(self, record: Record | Rejected) -> bool:
        """Count a record; False for rejected bytes."""
        if isinstance(record, Rejected):
            self.counts.rejected[record.reason] += 1
            self.counts.rejected_bytes += len(record.data)
            self._note_garbled(record)
            return False
        self.counts.records += 1
        return True

    def _note_garbled(self, record: Rejected) -> None:
        """Note since when a line carries without a pause what no instrument says."""
        begins_ns = record.t_rx_ns - round(record.line_bytes * self._byte_ns)
        if begins_ns > self._garbled_until_ns + NO_PAUSE_NS:
            self._garbled_ns = begins_ns
        self._garbled_until_ns = begins_ns + round(len(record.data) * self._byte_ns)

    def _held_up_s(self, record: Measured) -> float:
        """How long what stood on the line right before it may have held up a record at most."""
        begins_ns = record.t_rx_ns - round(record.line_bytes * self._byte_ns)
        if not self._byte_ns or begins_ns > self._garbled_until_ns + NO_PAUSE_NS:
            return 0.0
        return max(0.0, (begins_ns - self._garbled_ns) * 1e-9)

    def _left_instrument_ns(self, record: Measured) -> int:
        """When the frame's first byte left, less the age the record tells and the latency."""
        t_ns = record.t_rx_ns - self._latency_ns
        if self._byte_ns:
            t_ns -= round(record.line_bytes * self._byte_ns)
        return t_ns if record.age_s is UNSET else t_ns - round(record.age_s * 1e9)

    def _valid_at_ns(self, record: Measured, t_device_s: float | None) -> int:
        """When the record was true: by the time it tells if that is wanted, else by its arrival."""
        return self._told_ns(t_device_s, self._left_instrument_ns(record))

    def _told_ns(self, t_device_s: float | None, t_arrival_ns: int) -> int:
        """The moment that a time of the device means, which came to light then at the latest."""
        if self._day is None:
            return t_arrival_ns
        if t_device_s is None:
            self._untimed += 1
            return t_arrival_ns
        return self._day.take(round(1e3 * t_device_s), t_arrival_ns).t_ns


class FixIngest(DeviceIngest):
    """Fixes of a device, each a measurement of its own moment."""

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self._fixes: list[Measurement] = []

    def flush(self) -> list[Measurement]:
        """The fixes since the last call."""
        fixes, self._fixes = self._fixes, []
        self.counts.measurements += len(fixes)
        return fixes
