"""What every device's ingest has in common: counting, and when a frame left the instrument."""

from collections import Counter
from dataclasses import dataclass, field

from msgspec import UNSET

from drivers.records import Measured, Record, Rejected
from drivers.settings import Link, SerialLink

BITS_PER_BYTE = 10
"""8N1 on a serial line."""


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

    def __init__(self, link: Link, latency_ms: float) -> None:
        self.counts = DeviceCounts()
        self._latency_ns = round(latency_ms * 1e6)
        self._byte_ns = BITS_PER_BYTE * 1e9 / link.baud if isinstance(link, SerialLink) else 0.0

    def _count(self, record: Record | Rejected) -> bool:
        """Count a record; False for rejected bytes."""
        if isinstance(record, Rejected):
            self.counts.rejected[record.reason] += 1
            self.counts.rejected_bytes += len(record.data)
            return False
        self.counts.records += 1
        return True

    def _left_instrument_ns(self, record: Measured) -> int:
        """When the frame's first byte left, less the age the record tells and the latency."""
        age_ns = 0 if record.age_s is UNSET else round(record.age_s * 1e9)
        line_ns = round(record.line_bytes * self._byte_ns)
        return record.t_rx_ns - line_ns - age_ns - self._latency_ns
