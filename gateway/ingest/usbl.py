"""Acoustic records to fixes at the moment the reply reached the array."""

import math

from drivers.records import Record, Rejected, UsblRecord
from gateway.config import UsblDevice
from gateway.ingest.device import DeviceIngest
from gateway.messages import Measurement, RadialRate, UsblFix


class UsblIngest(DeviceIngest):
    """Acoustic records to fixes at the moment the reply reached the array.

    A radial rate is a measurement of its own: it stands where the fix beside it is not valid.
    """

    def __init__(self, name: str, device: UsblDevice) -> None:
        super().__init__(device)
        self._name = name
        self._fixes: list[Measurement] = []

    def take(self, record: Record | Rejected) -> None:
        """Take the next record; one that is invalid or no sighting from the array only counts."""
        if not self._count(record):
            return
        if not isinstance(record, UsblRecord):
            self.counts.ignored["not_usbl"] += 1
            return
        t_ns = self._valid_at_ns(record, record.t_device_s)
        fault = _fault(record)
        if fault is not None:
            self.counts.ignored[fault] += 1
        elif _sights(record):
            self._fixes.append(self._fix(record, t_ns))
        if record.range_rate_m_s is not None:
            self._fixes.append(
                RadialRate(t_ns, self._name, record.beacon, (record.range_rate_m_s,))
            )

    def flush(self) -> list[Measurement]:
        """The fixes since the last call."""
        fixes, self._fixes = self._fixes, []
        self.counts.measurements += len(fixes)
        return fixes

    def _fix(self, record: UsblRecord, t_ns: int) -> UsblFix:
        """One fix in radians, stamped with its time of validity."""
        return UsblFix(
            t_ns=t_ns,
            device=self._name,
            beacon=record.beacon,
            elevation=_radians(record.elevation_deg),
            bearing=_radians(record.bearing_deg),
            slant_range=record.slant_range_m,
        )


def _fault(record: UsblRecord) -> str | None:
    """Why a record is of no use; None if it holds a sighting from the array or a rate alone."""
    if not record.valid:
        return record.error_code or "invalid"
    if not (_sights(record) or record.range_rate_m_s is not None):
        return "no_sighting"
    return None if record.axes == "array" else "not_array_axes"


def _sights(record: UsblRecord) -> bool:
    return record.bearing_deg is not None or record.slant_range_m is not None


def _radians(degrees: float | None) -> float | None:
    return None if degrees is None else math.radians(degrees)
