"""All that is counted gathered into one report, and whether solutions flow as they should."""

import logging
import time
from collections.abc import Callable, Sequence

import msgspec

from gateway.filter_process.host import FilterHost
from gateway.health.hostclock import HostClock
from gateway.health.lines import Line
from gateway.health.plausible import Plausibility
from gateway.health.report import HealthReport
from gateway.latency import Passage, Stages
from gateway.machine.realtime import RealtimeStatus
from gateway.messages import FilterCounts, FilterTotals
from gateway.modes import Mode
from gateway.outputs.feeds import Feed
from gateway.outputs.schema import NavReport
from gateway.statefile import Keeper

LOSS_OVER_S = 10.0
"""A queue that has not dropped anything for so long keeps up again."""
STOOD_STILL_S = 2.0
"""Between two looks, which are a second apart."""
FLOWING_S = 3.0
"""A solution, or the last inertial data, younger than this counts as flowing."""

_log = logging.getLogger(__name__)


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
        self.host_clock = HostClock()
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
            doubts=self.host_clock.doubts + self.plausibility.doubts,
        )

    def line(self) -> str:
        """One line for the service manager."""
        mode, totals = Mode.INVALID if self._nav is None else self._nav.mode, self.totals
        fixes = f"{totals.fixes_used} fixes used, {totals.fixes_gated} refused" if totals else ""
        return f"{mode.value}; {fixes or 'no solution yet'}"
