"""IMU records to increments in body axes, each at its time of validity."""

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from drivers.records import ImuRecord, Record, Rejected
from gateway.clock import ArrivalClock, Unwrapper
from gateway.config import ImuDevice
from gateway.ingest.device import DeviceIngest
from gateway.messages import ImuBlock, Measurement
from gateway.nav.attitude import C_from_euler

Array = NDArray[np.float64]

SEQUENCE_MODULUS = 128
"""KVH sequence numbers."""
OUTAGE_S = 1.0
"""Silence after which a device may have begun its count anew, and a leap that says it has."""


class ImuIngest(DeviceIngest):
    """IMU records to increments in body axes."""

    def __init__(self, device: ImuDevice) -> None:
        super().__init__(device.link, device.clock.latency_ms)
        self._period_s = 1.0 / device.rate_hz
        self._device_clock = device.clock.source == "device"
        C_bs = C_from_euler(*np.radians(device.mounting_deg))
        self._C_bs_T: Array = np.ascontiguousarray(C_bs.T)
        self._clock = ArrivalClock()
        self._sequence = Unwrapper(SEQUENCE_MODULUS)
        self._microseconds = Unwrapper(1 << 32)
        self._count_s = 0.0
        self._t_last_ns = 0
        self._arrival_last_ns = 0
        self._t: list[int] = []
        self._rows: list[tuple[float, ...]] = []

    def take(self, record: Record | Rejected) -> None:
        """Take the next record; a sample marked invalid is left out like a missing one."""
        if not self._count(record):
            return
        if not isinstance(record, ImuRecord):
            self.counts.ignored["not_imu"] += 1
        elif not record.valid:
            self.counts.ignored["invalid"] += 1
        else:
            self._take_sample(record)

    def flush(self) -> list[Measurement]:
        """One block of the samples since the last call."""
        if not self._t:
            return []
        t_ns = np.array(self._t, dtype=np.int64)
        rows = np.array(self._rows)
        rows[:, 1:4] = rows[:, 1:4] @ self._C_bs_T
        rows[:, 4:7] = rows[:, 4:7] @ self._C_bs_T
        self.counts.measurements += len(t_ns)
        self._t, self._rows = [], []
        return [ImuBlock(t_ns.tobytes(), rows.tobytes())]

    def _take_sample(self, record: ImuRecord) -> None:
        """Place one sample in time and add its increments."""
        arrival_ns = self._left_instrument_ns(record)
        elapsed_s = (arrival_ns - self._arrival_last_ns) * 1e-9 if self._arrival_last_ns else 0.0
        self._arrival_last_ns = arrival_ns
        step_s, known = self._step(record, elapsed_s)
        if step_s > elapsed_s + OUTAGE_S or (elapsed_s > OUTAGE_S and not known):
            self._clock = ArrivalClock()
            step_s = elapsed_s
        if step_s <= 0.0:
            self.counts.ignored["repeated"] += 1
            return
        self._count_s += step_s
        t_ns = self._clock.stamp(self._count_s, arrival_ns)
        dt_s = step_s * (1.0 + self._clock.drift)
        t_ns = max(t_ns, self._t_last_ns + round(dt_s * 0.25e9))
        self._t_last_ns = t_ns
        samples = max(1, round(step_s / self._period_s))
        if samples > 1:
            self.counts.gaps += 1
            self.counts.missing += samples - 1
        self._add(record, t_ns, dt_s, samples)

    def _step(self, record: ImuRecord, elapsed_s: float) -> tuple[float, bool]:
        """Nominal seconds since the sample before, by the device's own time or count.

        Also whether they are known after a long silence: a count of 128 says less than that.
        """
        if self._device_clock and record.t_device_s is not None:
            counter, unit_s, known = self._microseconds, 1e-6, True
            value = round(record.t_device_s * 1e6)
        elif record.sequence is not None:
            counter, unit_s, known = self._sequence, self._period_s, False
            value = record.sequence
        else:
            return self._period_s * max(1, round(elapsed_s / self._period_s)), False
        last = counter.last
        if last is None:
            counter.extend(value, 0.0)
            return self._period_s, True
        return (counter.extend(value, elapsed_s / unit_s) - last) * unit_s, known

    def _add(self, record: ImuRecord, t_ns: int, dt_s: float, samples: int) -> None:
        """Add the increments over `dt_s`, missing samples taken to be like the one that came."""
        if record.delta_angle_rad is not UNSET:
            k = float(samples)
            a = record.delta_angle_rad
        else:
            assert record.rate_rad_s is not UNSET
            k, a = dt_s, record.rate_rad_s
        if record.delta_velocity_m_s is not UNSET:
            m = float(samples)
            v = record.delta_velocity_m_s
        else:
            assert record.specific_force_m_s2 is not UNSET
            m, v = dt_s, record.specific_force_m_s2
        missing_s = dt_s * (samples - 1) / samples
        self._t.append(t_ns)
        self._rows.append(
            (dt_s, k * a[0], k * a[1], k * a[2], m * v[0], m * v[1], m * v[2], missing_s)
        )
