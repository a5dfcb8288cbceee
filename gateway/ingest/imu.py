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
"""Silence after which the device may have been switched off and its count begun anew."""


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
        self._count_last_s: float | None = None
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
        count_s = self._device_count(record, arrival_ns)
        step_s = self._period_s if self._count_last_s is None else count_s - self._count_last_s
        if step_s <= 0.0:
            self.counts.ignored["repeated"] += 1
            return
        self._count_last_s = count_s
        t_ns = self._clock.stamp(count_s, arrival_ns)
        dt_s = step_s * (1.0 + self._clock.drift)
        t_ns = max(t_ns, self._t_last_ns + round(dt_s * 0.25e9))
        self._t_last_ns = t_ns
        samples = max(1, round(step_s / self._period_s))
        if samples > 1:
            self.counts.gaps += 1
            self.counts.missing += samples - 1
        self._add(record, t_ns, dt_s, samples)

    def _device_count(self, record: ImuRecord, arrival_ns: int) -> float:
        """The device's own time or number of samples, in nominal seconds, without wraps."""
        elapsed_s = (arrival_ns - self._arrival_last_ns) * 1e-9 if self._arrival_last_ns else 0.0
        self._arrival_last_ns = arrival_ns
        if elapsed_s > OUTAGE_S:
            self._clock = ArrivalClock()
        if self._device_clock and record.t_device_s is not None:
            return self._microseconds.extend(round(record.t_device_s * 1e6), elapsed_s * 1e6) * 1e-6
        if record.sequence is not None:
            return (
                self._sequence.extend(record.sequence, elapsed_s / self._period_s) * self._period_s
            )
        last_s = self._count_last_s if self._count_last_s is not None else 0.0
        return last_s + self._period_s * max(1, round(elapsed_s / self._period_s))

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
