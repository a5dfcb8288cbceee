"""Depths, bottom tracks and headings to fixes, each at its own moment.

Where an instrument says how uncertain its measurement is, that counts if it is worse than the
configuration's noise, never if it is better: instruments know their scatter, not their errors.
"""

import math
from collections.abc import Callable
from typing import Generic, TypeVar

from msgspec import UNSET, UnsetType

from drivers.records import DepthRecord, DvlRecord, HeadingRecord, Record, Rejected
from gateway.config import DepthDevice, DvlDevice, HeadingDevice
from gateway.ingest.device import FixIngest
from gateway.messages import BottomVelocity, Depth, HeadingFix, Measurement

R = TypeVar("R", DepthRecord, DvlRecord, HeadingRecord)


class AidingIngest(FixIngest, Generic[R]):
    """Records of one kind to fixes.

    Parameters
    ----------
    wanted
        The kind; other records count as ``not_<its name>``.
    fix
        ``(record, t_ns) -> fix``, or in a word why it is none.
    """

    def __init__(
        self,
        device: DepthDevice | DvlDevice | HeadingDevice,
        wanted: type[R],
        fix: Callable[[R, int], Measurement | str],
    ) -> None:
        super().__init__(device)
        self._kind = device.kind
        self._wanted: type[R] = wanted
        self._fix: Callable[[R, int], Measurement | str] = fix

    def take(self, record: Record | Rejected) -> None:
        """Take the next record; one that makes no fix counts."""
        if not self._count(record):
            return
        if not isinstance(record, self._wanted):
            self.counts.ignored[f"not_{self._kind}"] += 1
            return
        fix = self._fix(record, self._valid_at_ns(record, record.t_device_s))
        if isinstance(fix, str):
            self.counts.ignored[fix] += 1
        else:
            self._fixes.append(fix)


def depth_ingest(name: str, device: DepthDevice) -> AidingIngest[DepthRecord]:
    """Depths below the surface to heights above the ellipsoid."""

    def fix(record: DepthRecord, t_ns: int) -> Depth | str:
        if not record.valid:
            return "invalid"
        if record.depth_m is None:
            return "no_depth" if record.altitude_m is UNSET else "altitude"
        sd = _worse(device.noise.depth_m, record.sd_m)
        return Depth(t_ns, name, device.surface_height_m - record.depth_m, sd)

    return AidingIngest(device, DepthRecord, fix)


def dvl_ingest(name: str, device: DvlDevice) -> AidingIngest[DvlRecord]:
    """Bottom tracks in the log's own axes; what its tilts or compass have turned is not used."""

    def fix(record: DvlRecord, t_ns: int) -> BottomVelocity | str:
        if not record.valid:
            return record.error_code or "invalid"
        if record.velocity_m_s is None:
            return "no_velocity"
        if record.axes != "sensor":
            return "not_sensor_axes"
        x, y, z = record.velocity_m_s
        a, b, c = device.noise.velocity_m_s
        if record.sd_m_s is not UNSET:
            a, b, c = map(max, (a, b, c), record.sd_m_s)
        k = device.scale
        return BottomVelocity(t_ns, name, (k * x, k * y, k * z), (a, b, c))

    return AidingIngest(device, DvlRecord, fix)


def heading_ingest(name: str, device: HeadingDevice) -> AidingIngest[HeadingRecord]:
    """True headings; a magnetic one is not used."""

    def fix(record: HeadingRecord, t_ns: int) -> HeadingFix | str:
        if not record.valid:
            return "invalid"
        if record.heading_deg is None:
            return "no_heading"
        if record.reference != "true":
            return "magnetic"
        sd_deg = _worse(device.noise.heading_deg, record.sd_deg)
        return HeadingFix(t_ns, name, math.radians(record.heading_deg), math.radians(sd_deg))

    return AidingIngest(device, HeadingRecord, fix)


def _worse(stated: float, told: float | UnsetType) -> float:
    return stated if told is UNSET else max(stated, told)
