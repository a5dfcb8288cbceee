"""One mission: the emulator's bytes through the gateway's intake and filter, against the truth."""

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.capture.streams import Payload
from drivers.senders import Senders
from gateway.clock import ClockReport
from gateway.config import Config
from gateway.emulator import twin
from gateway.emulator.instruments import emissions
from gateway.emulator.ledger import Sent
from gateway.emulator.scenario import Scenario, UdpPort
from gateway.emulator.trajectory import Trajectory
from gateway.ingest import Intake, intakes
from gateway.messages import FilterCounts, ImuBlock, NavSolution
from gateway.modes import Mode
from gateway.nav import earth
from gateway.replay.passes import ForwardPass
from gateway.replay.pipeline import chosen, measurements
from tests.campaign.draw import mission
from tests.campaign.watch import Units, Verdict, WatchedDecoder, judge

RATE_HZ = 1.0
BLOCK_S = 5.0
NAVIGATING = (Mode.AIDED, Mode.DEAD_RECKONING)


@dataclass(frozen=True)
class DeviceRow:
    """What became of what a device sent."""

    codec: str
    sent: Sent
    verdict: Verdict
    records: int
    rejected: int
    rejected_bytes: int
    missing: int
    clock: ClockReport


@dataclass(frozen=True)
class Result:
    """What a mission came to.

    ``error_m``, ``sd_m`` (n, 3): errors north, east, down and the sigmas claimed, each second that
    the mode said it navigates. ``faults``: what must not be. ``took_s`` is of one core.
    """

    number: int
    error: str
    kinds: tuple[str, ...]
    devices: dict[str, DeviceRow]
    error_m: NDArray[np.float64]
    sd_m: NDArray[np.float64]
    modes: Counter[str]
    realignments: int
    mission_s: float
    took_s: float
    faults: list[str] = field(default_factory=list)

    @property
    def by_axis(self) -> NDArray[np.float64]:
        """Errors north, east, down in units of their own sigma, none below zero (n, 3)."""
        return np.abs(self.error_m) / self.sd_m

    @property
    def whole(self) -> NDArray[np.float64]:
        """Distances from the truth in units of the sigma of the position, all axes' (n,)."""
        return np.asarray(np.linalg.norm(self.error_m, axis=1) / np.linalg.norm(self.sd_m, axis=1))

    @property
    def worst(self) -> float:
        """The largest error of an axis."""
        return float(self.by_axis.max(initial=0.0))


class Wire:
    """The emulator's emissions as chunks with receive stamps, and notes of what they are."""

    def __init__(self, scenario: Scenario, trajectory: Trajectory) -> None:
        self._emissions = emissions(scenario, trajectory, float(scenario.start), BLOCK_S)
        self._t0_ns = round(float(scenario.start) * 1e9)
        self._packets = {n: isinstance(m.port, UdpPort) for n, m in scenario.devices.items()}
        self.sent = {name: Sent() for name in scenario.devices}
        self.units = {name: Units() for name in scenario.devices}

    def __iter__(self) -> Iterator[Payload]:
        """Bytes of one moment are one chunk, but for packets."""
        waiting: dict[str, tuple[int, bytes]] = {}
        stamped = dict.fromkeys(self.sent, 0)
        for e in self._emissions:
            self.sent[e.device].note(e)
            self.units[e.device].note(e)
            if not e.data:
                continue
            t_ns = self._t0_ns + round(e.t * 1e9)
            for name in [n for n, (t, _) in waiting.items() if t < t_ns or self._packets[n]]:
                stamp = self._stamp(stamped, name, waiting[name][0])
                yield Payload(name, waiting.pop(name)[1], stamp, "")
            before = waiting.get(e.device, (t_ns, b""))[1]
            waiting[e.device] = t_ns, before + e.data
        for name, (t_ns, data) in waiting.items():
            yield Payload(name, data, self._stamp(stamped, name, t_ns), "")

    @staticmethod
    def _stamp(stamped: dict[str, int], name: str, t_ns: int) -> int:
        """A stamp that the device had not before."""
        stamped[name] = max(t_ns, stamped[name] + 1)
        return stamped[name]


def fly(seed: int, number: int, longest_s: float, wide: bool) -> Result:
    """One mission of a campaign."""
    return run(number, *mission(seed, number, longest_s, wide=wide))


def run(number: int, data: dict[str, Any], error: str) -> Result:
    """Fly a mission with the filter of an error definition, and judge it."""
    scenario = twin.sound(data)
    config = chosen(msgspec.convert(twin.gateway_config(scenario), Config), error)
    trajectory = Trajectory(scenario.trajectory, scenario.duration_s)
    wire, devices = Wire(scenario, trajectory), intakes(config)
    watched = {name: _watch(intake) for name, intake in devices.items()}
    begun = time.process_time()
    forward = ForwardPass(config, RATE_HZ)
    solutions: list[NavSolution] = []
    given = samples = 0
    for measurement in measurements(wire, devices):
        if isinstance(measurement, ImuBlock):
            samples += len(measurement.t_ns) // 8
        else:
            given += 1
        solutions += [o for o in forward.feed(measurement) if isinstance(o, NavSolution)]
    solutions += [o for o in forward.finish() if isinstance(o, NavSolution)]
    took_s = time.process_time() - begun
    counts = forward.counts()
    rows = {
        name: _row(scenario.devices[name].codec, name, wire, watched[name], devices[name])
        for name in devices
    }
    faults = [fault for row in rows.values() for fault in row.verdict.faults]
    given -= len(forward._estimator._timeline.waiting())
    faults += _unaccounted(rows, devices, counts, samples, given)
    modes = Counter(str(s.mode) for s in solutions)
    starts = [s.mode is Mode.ALIGNING for s in solutions]
    error_m, sd_m = _errors(trajectory, float(scenario.start), solutions)
    return Result(
        number=number,
        error=error,
        kinds=tuple(sorted({type(f).__struct_config__.tag for f in scenario.faults})),
        devices=rows,
        error_m=error_m,
        sd_m=sd_m,
        modes=modes,
        realignments=sum(b and not a for a, b in pairwise(starts)) + counts.resets,
        mission_s=scenario.duration_s,
        took_s=took_s,
        faults=faults,
    )


def _watch(intake: Intake) -> WatchedDecoder:
    """Have a device's decoder watched; all its bytes are of one sender."""
    watched = WatchedDecoder(intake.senders._make)
    intake.senders = Senders(lambda: watched)
    return watched


def _row(codec: str, name: str, wire: Wire, watched: WatchedDecoder, intake: Intake) -> DeviceRow:
    counts = intake.counts
    return DeviceRow(
        codec,
        wire.sent[name],
        judge(name, wire.units[name], watched),
        counts.records,
        sum(counts.rejected.values()),
        counts.rejected_bytes,
        counts.missing,
        intake.clock_report(),
    )


def _unaccounted(
    rows: dict[str, DeviceRow],
    devices: dict[str, Intake],
    counts: FilterCounts,
    samples: int,
    given: int,
) -> Iterator[str]:
    """Sums that do not come out."""
    for name, row in rows.items():
        told = devices[name].counts
        if told.bytes != row.sent.bytes:
            yield f"{name}: {row.sent.bytes} bytes sent, {told.bytes} counted"
        is_one = devices[name].kinds[name] not in ("usbl", "lbl")  # of a reply there may be two
        if is_one and told.records != told.measurements + sum(told.ignored.values()):
            yield f"{name}: {told.records} records, {told.measurements} used, {told.ignored}"
        told_all = row.clock.source in ("time", "sequence") and not row.clock.resets
        if name == "imu0" and told_all and row.verdict.made != told.measurements + told.missing:
            yield (
                f"{name}: {row.verdict.made} made, {told.measurements} used,"
                f" {told.missing} reported missing"
            )
    if counts.imu_samples != samples:
        yield f"filter: {samples} samples given, {counts.imu_samples} counted"
    said = (
        counts.fixes_used
        + counts.fixes_gated
        + counts.fixes_too_late
        + counts.fixes_too_early
        + counts.fixes_duplicate
    )
    if said != given:
        yield f"filter: {given} fixes given, {said} accounted for: {counts}"


def _errors(
    trajectory: Trajectory, start: float, solutions: list[NavSolution]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    claimed = [s for s in solutions if s.mode in NAVIGATING]
    if not claimed:
        return np.empty((0, 3)), np.empty((0, 3))
    t = np.array([s.t_ns * 1e-9 - start for s in claimed])
    truth = trajectory.geodetic(t)
    R_M, R_N = earth.radii(truth.lat)
    lat, lon, h = np.array([(s.lat, s.lon, s.h) for s in claimed]).T
    north = (lat - truth.lat) * (R_M + truth.h)
    east = (lon - truth.lon) * (R_N + truth.h) * np.cos(truth.lat)
    error_m = np.column_stack([north, east, truth.h - h])
    return error_m, np.array([s.sd_position for s in claimed])
