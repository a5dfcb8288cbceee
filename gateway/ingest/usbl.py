"""Acoustic records to fixes at the moment the reply reached the array."""

import math

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from drivers.records import Record, Rejected, TimeDifference, UsblRecord
from gateway.config import UsblDevice
from gateway.fusion.direction_cosines import direction, in_range
from gateway.ingest.device import FixIngest
from gateway.messages import BeaconPlace, RadialRate, UsblFix

AGAIN_NS = 300_000_000
"""A fix of the same beacon in other words within this is the same fix."""

Array = NDArray[np.float64]
Angles = tuple[float | None, float | None]
"""Elevation and bearing (rad)."""


class UsblIngest(FixIngest):
    """Acoustic records to fixes at the moment the reply reached the array.

    A radial rate is a measurement of its own: it stands where the fix beside it is not valid. Of an
    instrument that says each fix several times (from the head, from north, as a latitude and
    longitude), the way it was said first is the one that counts.
    """

    def __init__(self, name: str, device: UsblDevice, sound_speed_m_s: float) -> None:
        super().__init__(device)
        self._name = name
        self._sound_speed = sound_speed_m_s
        self._places = device.navigates_by == "gateway"
        self._by_differences = device.direction == "differences"
        self._below = device.looks == "down"
        self._limits = device.range_limits_m or (0.0, math.inf)
        self._elements = {str(k): np.array(at) for k, at in enumerate(device.elements_m, 1)}
        self._said: dict[str, tuple[str, int]] = {}

    def take(self, record: Record | Rejected) -> None:
        """Take the next record; one that is invalid or no sighting from the array only counts."""
        if not self._count(record):
            return
        if not isinstance(record, UsblRecord):
            self.counts.ignored["not_usbl"] += 1
            return
        t_ns = self._valid_at_ns(record, record.t_device_s)
        fix = self._fix(record, t_ns)
        if isinstance(fix, str):
            self.counts.ignored[fix] += 1
        elif fix is not None:
            self._fixes.append(fix)
        if record.range_rate_m_s is not None:
            self._fixes.append(
                RadialRate(t_ns, self._name, record.beacon, (record.range_rate_m_s,))
            )

    def _fix(self, record: UsblRecord, t_ns: int) -> UsblFix | BeaconPlace | str | None:
        """One fix at its time of validity, or why there is none; None where a rate is all."""
        if not record.valid:
            return record.error_code or "invalid"
        place = _place(record)
        if place is not None and not self._places:
            return "place"
        if self._is_again(record.beacon, record.axes if place is None else "place", t_ns):
            return "repeated"
        if place is not None:
            return BeaconPlace(t_ns, self._name, record.beacon, *place)
        return self._sighting(record, t_ns)

    def _is_again(self, beacon: str, words: str, t_ns: int) -> bool:
        """Whether the last fix of a beacon is said in other words; otherwise it is noted."""
        before, t_before_ns = self._said.get(beacon, (words, t_ns))
        if words != before and abs(t_ns - t_before_ns) < AGAIN_NS:
            return True
        self._said[beacon] = words, t_ns
        return False

    def _sighting(self, record: UsblRecord, t_ns: int) -> UsblFix | str | None:
        """A direction, a range or both, or why there are none."""
        angles, slant_range = self._angles(record), record.slant_range_m
        if isinstance(angles, str):
            return angles
        if angles[1] is None and slant_range is None:
            return None if record.range_rate_m_s is not None else "no_sighting"
        if slant_range is not None and not in_range(slant_range, *self._limits):
            return "range"
        axes = "array" if self._by_differences else record.axes
        timed = self._wants_device_time and record.t_device_s is not None
        t_sd_s = 0.0 if timed else self._held_up_s(record)
        return UsblFix(t_ns, self._name, record.beacon, *angles, slant_range, axes, t_sd_s=t_sd_s)

    def _angles(self, record: UsblRecord) -> Angles | str:
        """Elevation and bearing, or why there are none; of differences they are the array's own."""
        if not self._by_differences:
            return _radians(record.elevation_deg), _radians(record.bearing_deg)
        if record.differences is UNSET:
            return None, None
        pairs = [pair for pair in map(self._pair, record.differences) if pair is not None]
        if not pairs:
            return "no_direction"
        baselines, delays = map(np.array, zip(*pairs, strict=True))
        found = direction(baselines, delays, self._sound_speed, below=self._below)
        return "no_direction" if found is None else found

    def _pair(self, heard: TimeDifference) -> tuple[Array, float] | None:
        """Baseline (2,) of two elements and the delay between them; None for unknown ones."""
        if heard.element not in self._elements or heard.than not in self._elements:
            return None
        baseline = self._elements[heard.element] - self._elements[heard.than]
        return baseline[:2], heard.delay_s


def _place(record: UsblRecord) -> tuple[float, float] | None:
    """Latitude and longitude (rad), where they are all that a record says of a beacon."""
    if record.bearing_deg is not None or record.slant_range_m is not None:
        return None
    if record.lat_deg is UNSET or record.lon_deg is UNSET:
        return None
    return math.radians(record.lat_deg), math.radians(record.lon_deg)


def _radians(degrees: float | None) -> float | None:
    return None if degrees is None else math.radians(degrees)
