"""How the gateway fares: one report of devices, filter and outputs, and the alarms that follow."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import msgspec

from drivers.links import LinkCounts
from gateway.clock import ClockReport
from gateway.config import DeviceKind
from gateway.filter_process.host import FilterHost, HostStatus
from gateway.ingest import Ingest, Intake
from gateway.latency import Passage, StageReport, Stages
from gateway.machine.realtime import RealtimeStatus
from gateway.messages import FilterCounts, FilterTotals
from gateway.modes import Mode
from gateway.outputs.feeds import Feed
from gateway.outputs.schema import NavReport
from gateway.outputs.sinks import SinkStatus
from gateway.plausible import Doubt, Plausibility
from gateway.statefile import Keeper, KeeperStatus

SILENT_S: dict[DeviceKind, float] = {
    "imu": 1.0,
    "usbl": 60.0,
    "lbl": 60.0,
    "gnss": 10.0,
    "depth": 10.0,
    "dvl": 10.0,
    "heading": 10.0,
}
"""Silence of an open line after which its device is called silent; USBL may interrogate slowly."""
FIRST_S = 10.0
"""How long a device may take to speak for the first time."""
LOSS_OVER_S = 10.0
"""A queue that has not dropped anything for so long keeps up again."""
STOOD_STILL_S = 2.0
"""Between two looks, which are a second apart."""
FLOWING_S = 3.0
"""A solution, or the last inertial data, younger than this counts as flowing."""

_log = logging.getLogger(__name__)


class SenderReport(msgspec.Struct, frozen=True):
    """What became of one sender's bytes."""

    bytes: int
    records: int
    rejected_bytes: int


class LinkReport(msgspec.Struct, frozen=True):
    """The line of a device.

    Attributes
    ----------
    place
        What its messages call it; null until it was open for the first time.
    opened
        How often; once more than it was lost, while it is up.
    senders
        Who spoke on it, the last one at the end; beyond sixteen those heard longest ago are summed
        up as ``others``.
    """

    place: str | None
    up: bool
    opened: int
    bytes: int
    chunks: int
    senders: dict[str, SenderReport]


class DeviceReport(msgspec.Struct, frozen=True):
    """One device: its line, and what became of its bytes.

    ``line`` is the device that names the line: the bytes of one that several share, and what of it
    nobody takes, are counted there alone.
    """

    kind: DeviceKind
    codec: str
    line: str
    silent_s: float | None
    bytes: int
    records: int
    measurements: int
    rejected: dict[str, int]
    rejected_bytes: int
    ignored: dict[str, int]
    gaps: int
    missing: int
    refused_datagrams: int
    kernel_dropped: int
    link: LinkReport
    clock: ClockReport


class HealthReport(msgspec.Struct, frozen=True):
    """The daemon's status, as published on Zenoh."""

    vehicle: str
    t_s: float
    up_s: float
    mode: Mode
    fix_age_s: float | None
    devices: dict[str, DeviceReport]
    filter: HostStatus
    totals: FilterTotals | None
    outputs: list[SinkStatus]
    latency: list[StageReport]
    realtime: RealtimeStatus
    state_file: KeeperStatus | None
    doubts: list[Doubt] = []


@dataclass
class Voice:
    """One device as it is heard: when it spoke, and whether its silence has been said."""

    name: str
    kind: DeviceKind
    ingest: Ingest
    heard_at: float | None = None
    _records: int = field(default=0, init=False)
    _quiet_since: float | None = field(default=None, init=False)
    _said_silent: bool = field(default=False, init=False)

    def opened(self, now: float) -> None:
        """Note that its line is open."""
        self._quiet_since = now

    def heard(self, now: float) -> None:
        """Note that it spoke."""
        self.heard_at = self._quiet_since = now

    def stood_still(self, seconds: float) -> None:
        """Do not count a time in which nobody listened as silence."""
        if self._quiet_since is not None:
            self._quiet_since += seconds

    def lost(self) -> None:
        """Note that its line is gone."""
        self._quiet_since, self._said_silent = None, False

    def watch(self, now: float) -> None:
        """Say once that it is silent on an open line, and once that it speaks again."""
        if self._quiet_since is None:
            return
        quiet_s, limit_s = now - self._quiet_since, SILENT_S[self.kind]
        if self.heard_at is None:
            limit_s = max(limit_s, FIRST_S)
        if quiet_s <= limit_s and self._said_silent:
            _log.info("%s: speaks", self.name)
        elif quiet_s > limit_s and not self._said_silent:
            _log.warning("%s: silent for %.0f s", self.name, quiet_s)
        self._said_silent = quiet_s > limit_s

    def listen(self, now: float) -> None:
        """Find by its records whether it spoke, where bytes of a line may be another's."""
        records, self._records = self._records, self.ingest.counts.records
        if self._records > records:
            self.heard(now)


@dataclass
class Line:
    """One line as the daemon runs it, with the devices that share it."""

    intake: Intake
    link: LinkCounts = field(default_factory=LinkCounts)
    place: str | None = None
    up: bool = False
    times_opened: int = 0
    voices: list[Voice] = field(init=False)

    def __post_init__(self) -> None:
        kinds = self.intake.kinds
        self.voices = [Voice(n, kinds[n], ingest) for n, ingest in self.intake.ingests.items()]

    @property
    def name(self) -> str:
        """That of its first device."""
        return self.intake.name

    def opened(self, now: float, place: str) -> None:
        """Note that the line is open, and what it is called."""
        self.place, self.up = place, True
        self.times_opened += 1
        for voice in self.voices:
            voice.opened(now)

    def heard(self, now: float) -> None:
        """Note that bytes came; of whom among several, their records tell."""
        if len(self.voices) == 1:
            self.voices[0].heard(now)

    def lost(self) -> None:
        """Note that the line is gone, which is said by those who try to open it again."""
        self.up = False
        for voice in self.voices:
            voice.lost()

    def stood_still(self, seconds: float) -> None:
        """Do not count a time in which nobody listened as silence."""
        for voice in self.voices:
            voice.stood_still(seconds)

    def watch(self, now: float) -> None:
        """Say of whom nothing is heard."""
        for voice in self.voices:
            if len(self.voices) > 1:
                voice.listen(now)
            voice.watch(now)

    def reports(self, now: float) -> Iterator[tuple[str, DeviceReport]]:
        """By device its counts and its line's, of which the first one has the bytes."""
        link = self._link_report()
        for voice in self.voices:
            counts, heard_at = voice.ingest.counts, voice.heard_at
            yield (
                voice.name,
                DeviceReport(
                    kind=voice.kind,
                    codec=self.intake.codec,
                    line=self.name,
                    silent_s=None if heard_at is None else round(now - heard_at, 2),
                    bytes=counts.bytes,
                    records=counts.records,
                    measurements=counts.measurements,
                    rejected=dict(counts.rejected),
                    rejected_bytes=counts.rejected_bytes,
                    ignored=dict(counts.ignored),
                    gaps=counts.gaps,
                    missing=counts.missing,
                    refused_datagrams=self.link.refused,
                    kernel_dropped=self.link.kernel_dropped,
                    link=link,
                    clock=voice.ingest.clock_report(),
                ),
            )

    def _link_report(self) -> LinkReport:
        senders = self.intake.senders
        counted = dict(senders.counts)
        if senders.others.bytes:
            counted["others"] = senders.others
        return LinkReport(
            place=self.place,
            up=self.up,
            opened=self.times_opened,
            bytes=self.link.bytes,
            chunks=self.link.chunks,
            senders={
                who: SenderReport(told.bytes, told.records, told.rejected_bytes)
                for who, told in counted.items()
            },
        )


class Losses:
    """Says once that a queue is dropping what it holds, and once how much it was."""

    def __init__(self) -> None:
        self._seen: dict[str, int] = {}
        self._under_way: dict[str, tuple[int, float]] = {}  # total before, time of the last loss

    def watch(self, where: str, total: int, now: float) -> None:
        """Look at a running total."""
        before = self._seen.get(where, 0)
        self._seen[where] = total
        if total > before:
            if where not in self._under_way:
                _log.warning("%s is full, data is dropped and counted", where)
            self._under_way[where] = (self._under_way.get(where, (before, now))[0], now)
        elif where in self._under_way and now - self._under_way[where][1] > LOSS_OVER_S:
            _log.info("%s is no longer full; lost: %d", where, total - self._under_way[where][0])
            del self._under_way[where]


class Health:
    """Gathers what the parts count, and knows whether solutions flow as they should."""

    def __init__(
        self,
        vehicle: str,
        lines: Sequence[Line],
        host: FilterHost,
        feeds: Sequence[Feed],
        keeper: Keeper | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._vehicle = vehicle
        self._clock = clock
        self._lines = lines
        self._host = host
        self._feeds = feeds
        self._keeper = keeper
        self._begun = self._clock()
        self._solved_at = self._watched_at = self._begun
        self._nav: NavReport | None = None
        self._stages = Stages()
        self._losses = Losses()
        self.passage = Passage(self._stages)
        self.plausibility = Plausibility([line.intake for line in lines])
        self.totals: FilterCounts | None = None
        self.realtime = RealtimeStatus()

    def solved(self, nav: NavReport) -> None:
        """Note a solution; a change of mode is said."""
        before = Mode.INVALID if self._nav is None else self._nav.mode
        if nav.mode != before:
            _log.info("navigation: %s (was %s)", nav.mode.value, before.value)
        self._nav = nav
        self._solved_at = self._clock()

    def is_flowing(self) -> bool:
        """Whether solutions come, or there is nothing to make them of.

        A pulled IMU cable is no reason to start the gateway again; inertial data without solutions
        is.
        """
        now = self._clock()
        if now - self._solved_at < FLOWING_S:
            return True
        imus = (v for line in self._lines for v in line.voices if v.kind == "imu")
        return all(now - v.heard_at > FLOWING_S for v in imus if v.heard_at is not None)

    def watch(self) -> None:
        """Raise the alarms that time brings."""
        now = self._clock()
        self._stages.turn(now)
        stood_s, self._watched_at = now - self._watched_at, now
        if stood_s > STOOD_STILL_S:
            _log.warning("the gateway stood still for %.1f s: stopped, or starved", stood_s)
            for line in self._lines:
                line.stood_still(stood_s)
            self.plausibility.start_over()
        for line in self._lines:
            line.watch(now)
            self._losses.watch(f"{line.name}: the system's buffer", line.link.kernel_dropped, now)
        self.plausibility.look(now)
        self._losses.watch("filter: the queue", self._host.status.dropped, now)
        if self._nav is not None and now - self._solved_at > FLOWING_S:
            _log.warning("navigation: no solution for %.0f s", now - self._solved_at)
            self._nav = None

    def report(self) -> HealthReport:
        """Everything, now."""
        now = self._clock()
        return HealthReport(
            vehicle=self._vehicle,
            t_s=time.time(),
            up_s=round(now - self._begun, 1),
            mode=Mode.INVALID if self._nav is None else self._nav.mode,
            fix_age_s=None if self._nav is None else self._nav.fix_age_s,
            devices=dict(report for line in self._lines for report in line.reports(now)),
            filter=self._host.status,
            totals=msgspec.convert(self.totals, FilterTotals | None, from_attributes=True),
            outputs=[feed.status() for feed in self._feeds],
            latency=self._stages.report(),
            realtime=self.realtime,
            state_file=None if self._keeper is None else self._keeper.status,
            doubts=self.plausibility.doubts,
        )

    def line(self) -> str:
        """One line for the service manager."""
        mode, totals = Mode.INVALID if self._nav is None else self._nav.mode, self.totals
        fixes = f"{totals.fixes_used} fixes used, {totals.fixes_gated} refused" if totals else ""
        return f"{mode.value}; {fixes or 'no solution yet'}"
