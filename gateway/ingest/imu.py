"""IMU records to increments in body axes, each at its time of validity."""

from array import array
from collections.abc import Mapping

import msgspec
import numpy as np
from msgspec import UNSET

from drivers.records import ImuRecord, Record, Rejected
from gateway.clock import NEVER, ClockMemory, ClockReport, DeviceClock, Source, Tick
from gateway.config import ImuDevice, wire_format
from gateway.ingest.device import DeviceIngest
from gateway.ingest.felt import Felt
from gateway.ingest.uncounted import Bridge, Frames, in_doubt_s
from gateway.messages import ImuBlock, Measurement
from gateway.nav.attitude import C_from_euler

Vector = tuple[float, float, float]
Increments = tuple[Vector, Vector]
"""Angle (rad) and velocity (m/s), body axes."""

MICROSECOND = 1e-6
SLOWEST = 0.25
"""Fraction of its interval by which a sample follows the one before at least."""
TIMELESS_S = 1.0
"""For how long samples that lost their time are left out; after that the unit tells none."""
QUEUE_S, QUEUE_SHARE = 0.1, 0.1
"""How late the first sample after a silence may be, also in parts of the silence."""
OVERDUE_S = 5.0
"""How long after a silence at least what came late by it may be made up for."""


class ImuIngest(DeviceIngest):
    """IMU records to increments in body axes.

    Attributes
    ----------
    rate_hz
        As declared.
    felt
        What it felt since that was last looked at.
    """

    def __init__(self, device: ImuDevice) -> None:
        super().__init__(device)
        self.rate_hz = device.rate_hz
        self.felt = Felt()
        self._period_s = 1.0 / device.rate_hz
        self._counting = wire_format(device)[0].counting
        C_bs = C_from_euler(*np.radians(device.mounting_deg)).tolist()
        self._C_bs: tuple[Vector, ...] = tuple(map(tuple, C_bs))
        self._source: Source = "frames"
        self._tells_apart = (self._counting.time_step_s or 0.0) < self._period_s
        self._told_s: float | None = None
        self._timeless = 0
        self._known: dict[str, ClockMemory] = {}
        self._clock = self._make_clock()
        self._frames, self._bridge = Frames(self._period_s), Bridge()
        self._t_last_ns: int | None = None
        self._bridged = self._since = 0
        self._silence_s, self._silent_until_ns = 0.0, 0
        self._chunk: list[ImuRecord] = []
        # One sample at a time, mostly: what numpy does at once for many costs more for one.
        self._t = array("q")
        self._rows = array("d")

    def take(self, record: Record | Rejected) -> None:
        """Take the next record; a sample marked invalid is left out like a missing one."""
        if not self._count(record):
            return
        if not isinstance(record, ImuRecord):
            self.counts.ignored["not_imu"] += 1
        elif not record.valid:
            self.counts.ignored["invalid"] += 1
        elif self._is_again(record):
            self.counts.ignored["repeated"] += 1
        elif self._lacks_time(record):
            self.counts.ignored["untimed"] += 1
        else:
            self._chunk.append(record)

    def end_of_chunk(self) -> None:
        """Place the samples that came together in time, and add their increments."""
        if not self._chunk:
            return
        records, self._chunk = self._chunk, []
        source = self._source_of(records[0])
        if source != self._source:
            self._source = source
            self._clock = self._make_clock()
        arrived = [self._left_instrument_ns(record) for record in records]
        if self._bridge.samples and source == "frames":
            overdue = self._made_up_for(records, arrived[-1])
            records, arrived = records[overdue:], arrived[overdue:]
            if not records:
                return
        values = self._values(records, arrived[-1])
        ticks = self._clock.take(list(zip(values, arrived, strict=True)))
        for record, tick in zip(records, ticks, strict=True):
            self._add_sample(record, tick)

    def flush(self) -> list[Measurement]:
        """One block of the samples since the last call."""
        if not self._t:
            return []
        block = ImuBlock(self._t.tobytes(), self._rows.tobytes())
        self.counts.measurements += len(self._t)
        self.felt.add(self._rows)
        self._t, self._rows = array("q"), array("d")
        return [block]

    def learn(self) -> None:
        """Learn how to place what comes next from what came."""
        self._clock.learn()

    def clock_report(self) -> ClockReport:
        """How the samples are placed in time."""
        return self._clock.report(self._source)

    def clock_memory(self) -> dict[str, ClockMemory]:
        """What outlives this process: of frames that nobody counts the drift alone."""
        memory = self._clock.memory()
        if memory is None:
            return self._known
        if self._source == "frames":
            memory = msgspec.structs.replace(memory, placed=None)
        return {self._source: memory}

    def resume(self, clocks: Mapping[str, ClockMemory]) -> None:
        """Go on from what an earlier process knew, once it shows what the samples go by."""
        self._known = dict(clocks)
        self._clock = self._make_clock()

    def _is_again(self, record: ImuRecord) -> bool:
        """Whether a line says a sample twice, as its own time tells, whatever it is placed by."""
        before, self._told_s = self._told_s, record.t_device_s
        return self._tells_apart and record.t_device_s is not None and record.t_device_s == before

    def _lacks_time(self, record: ImuRecord) -> bool:
        """Whether a sample lost the time that those before it told; for a while it is left out."""
        if self._source != "time" or record.t_device_s is not None:
            self._timeless = 0
            return False
        self._timeless += 1
        return self._timeless * self._period_s < TIMELESS_S

    def _source_of(self, record: ImuRecord) -> Source:
        """What tells when a sample was taken: its own time, its number, or that it came."""
        if self._wants_device_time and record.t_device_s is not None:
            return "time"
        if record.sequence is not None and self._counting.sequence_modulus is not None:
            return "sequence"
        return "frames"

    def _make_clock(self) -> DeviceClock:
        clock, known = self._new_clock(), self._known.pop(self._source, None)
        if known is not None:
            clock.resume(known)
        return clock

    def _new_clock(self) -> DeviceClock:
        counting = self._counting
        if self._source == "time":
            turn_s = counting.time_modulus_s
            return DeviceClock(MICROSECOND, NEVER if turn_s is None else round(turn_s * 1e6))
        unit_s = self._period_s
        if self._source == "sequence":
            return DeviceClock(counting.sequence_s or unit_s, counting.sequence_modulus or NEVER)
        return DeviceClock(unit_s, NEVER)

    def _values(self, records: list[ImuRecord], t_arrival_ns: int) -> list[int]:
        """Counts of the samples that came together, the last of them just now."""
        if self._source == "time":
            return [round((r.t_device_s or 0.0) * 1e6) for r in records]
        if self._source == "sequence":
            return [r.sequence or 0 for r in records]
        lost = self._frames.lost(self._clock, len(records), t_arrival_ns)
        return self._frames.number(len(records), lost)

    def _made_up_for(self, records: list[ImuRecord], t_arrival_ns: int) -> int:
        """How many of the frames that came together are among those taken for lost."""
        if t_arrival_ns > self._silent_until_ns + round(1e9 * max(self._silence_s, OVERDUE_S)):
            self._bridge.forget()
        surplus = self._frames.surplus(self._clock, len(records), t_arrival_ns)
        overdue = min(self._bridge.samples, len(records), surplus)
        for record in records[:overdue]:
            self._bridge.exchange(*self._increments(record, self._period_s, 1))
        self.counts.ignored["overdue"] += overdue
        return overdue

    def _add_sample(self, record: ImuRecord, tick: Tick) -> None:
        """Add one sample where its clock has placed it, behind the one before."""
        t_ns, step_s = tick
        if self._t_last_ns is None:
            step_s = self._period_s
            self._t_last_ns = t_ns - round(step_s * 1e9)
        if step_s <= 0.0:
            self.counts.ignored["repeated"] += 1
            return
        dt_s = step_s * (1.0 + self._clock.drift)
        samples = max(1, round(step_s / self._period_s))
        if self._bridged and self._overdue(1, t_ns):
            return
        if samples > 1:
            self.counts.gaps += 1
            self.counts.missing += samples - 1
            self._silence_s, self._silent_until_ns = step_s, t_ns
            if self._source == "frames":
                share = self._increments(record, self._period_s, 1)
                self._bridge.build(samples - 1, *share)
            else:
                self._bridged, self._since = samples - 1, 0
        self._t_last_ns = t_ns = max(t_ns, self._t_last_ns + round(dt_s * SLOWEST * 1e9))
        self._add(record, t_ns, dt_s, samples)

    def _overdue(self, arrived: int, t_ns: int) -> int:
        """Of samples that came together, how many are made up for already; they are left out.

        After a silence what waited in a queue may come as fast as the line can. Where neither count
        nor time tells it from the present, it shows in that more come than were taken meanwhile.
        """
        if t_ns > self._silent_until_ns + round(1e9 * max(self._silence_s, OVERDUE_S)):
            self._bridged = 0
        queue_s = min(QUEUE_S, QUEUE_SHARE * self._silence_s)
        taken = ((t_ns - self._silent_until_ns) * 1e-9 + queue_s) / self._period_s
        overdue = min(self._bridged, arrived, max(0, int(self._since + arrived - taken)))
        self._bridged -= overdue
        self._since += arrived - overdue
        self.counts.ignored["overdue"] += overdue
        return overdue

    def _add(self, record: ImuRecord, t_ns: int, dt_s: float, samples: int) -> None:
        """Add the increments over `dt_s`, missing samples taken to be like the one that came."""
        turned, gained = self._increments(record, dt_s, samples)
        missing_s = dt_s * (samples - 1) / samples
        if self._source == "frames":
            turned, gained = self._bridge.settle(turned, gained)
            missing_s = in_doubt_s(missing_s)
        self._t.append(t_ns)
        self._rows.extend((dt_s, *turned, *gained, missing_s))

    def _increments(self, record: ImuRecord, dt_s: float, samples: int) -> Increments:
        """What so many samples alike add in `dt_s`."""
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
        return self._in_body(k, a), self._in_body(m, v)

    def _in_body(self, factor: float, v_s: Vector) -> Vector:
        """A vector in sensor axes, times a factor, in body axes."""
        x, y, z = factor * v_s[0], factor * v_s[1], factor * v_s[2]
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self._C_bs
        return xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z
