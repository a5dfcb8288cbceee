"""Acoustic records to fixes at the moment the reply reached the array."""

import math

from drivers.records import Record, Rejected, UsblRecord
from gateway.config import UsblDevice
from gateway.ingest.device import DeviceIngest
from gateway.messages import Measurement, UsblFix


class UsblIngest(DeviceIngest):
    """Acoustic records to fixes at the moment the reply reached the array."""

    def __init__(self, name: str, device: UsblDevice) -> None:
        super().__init__(device.link, device.clock.latency_ms)
        self._name = name
        self._fixes: list[Measurement] = []

    def take(self, record: Record | Rejected) -> None:
        """Take the next record; one that is invalid or no sighting from the array only counts."""
        if not self._count(record):
            return
        if not isinstance(record, UsblRecord):
            self.counts.ignored["not_usbl"] += 1
        elif not record.valid:
            self.counts.ignored[record.error_code or "invalid"] += 1
        elif record.axes != "array" or (
            record.bearing_deg is None and record.slant_range_m is None
        ):
            self.counts.ignored["not_array_axes"] += 1
        else:
            self._fixes.append(self._fix(record))

    def flush(self) -> list[Measurement]:
        """The fixes since the last call."""
        fixes, self._fixes = self._fixes, []
        self.counts.measurements += len(fixes)
        return fixes

    def _fix(self, record: UsblRecord) -> UsblFix:
        """One fix in radians, stamped with its time of validity."""
        return UsblFix(
            t_ns=self._left_instrument_ns(record),
            device=self._name,
            beacon=record.beacon,
            elevation=_radians(record.elevation_deg),
            bearing=_radians(record.bearing_deg),
            slant_range=record.slant_range_m,
        )


def _radians(degrees: float | None) -> float | None:
    return None if degrees is None else math.radians(degrees)
