"""What each configured output is given, and how often: the solution in time or an honest blank."""

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any, Protocol

import msgspec

from gateway.config import NmeaOutput, Output, ZenohOutput
from gateway.outputs import nmea, nmea_targets
from gateway.outputs.schema import (
    CalibrationReport,
    InnovationReport,
    NavReport,
    TargetReport,
)
from gateway.outputs.sinks import Sink, SinkStatus, open_sink

STALE_S = 1.5
"""Without a solution for so long the sentences say that there is none."""


class Feed(Protocol):
    """One output; nothing here blocks or raises."""

    @property
    def name(self) -> str:
        """Of the output, as in its status."""
        ...

    def nav(self, report: NavReport) -> bool:
        """Take every solution; pass on those that are due, and say whether this one was."""
        ...

    def innovation(self, report: InnovationReport) -> None:
        """Take the verdict on a fix."""
        ...

    def calibration(self, report: CalibrationReport) -> None:
        """Take the estimated constants."""
        ...

    def target(self, report: TargetReport, own: NavReport) -> None:
        """Take where a target is, and our own solution of the same moment."""
        ...

    def health(self, report: msgspec.Struct) -> None:
        """Take the daemon's status."""
        ...

    def status(self) -> SinkStatus:
        """How the output itself fares."""
        ...

    async def run(self) -> None:
        """Do what must happen without a solution; ends when nobody can read any more."""
        ...


@asynccontextmanager
async def open_feed(
    output: Output, vehicle: str, targets: Sequence[str] = ()
) -> AsyncIterator[Feed]:
    """Open a configured output for as long as the body runs; `targets` are names."""
    if isinstance(output, NmeaOutput):
        async with open_sink(output.link) as sink:
            yield _NmeaFeed(output, sink) if output.target is None else _TargetFeed(output, sink)
    else:
        from gateway.outputs.zenoh import open_publisher  # zenoh only where it is asked for

        async with open_publisher(output, vehicle, targets) as publisher:
            yield _ZenohFeed(output, publisher)


class _Pace:
    """Picks the first report of each period."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._tick: int | None = None

    def is_due(self, t_ns: int) -> bool:
        """Whether a report of that time begins a period (the clock may step either way)."""
        tick = t_ns // self._period_ns
        due = tick != self._tick
        self._tick = tick
        return due


class _NmeaFeed:
    """NMEA 0183 sentences to a sink."""

    def __init__(self, settings: NmeaOutput, sink: Sink) -> None:
        self._settings = settings
        self._sink = sink
        self._pace = _Pace(settings.rate_hz)
        self._heard = self._blanked = time.monotonic()

    @property
    def name(self) -> str:
        return self._sink.name

    def nav(self, report: NavReport) -> bool:
        return self._take(report)

    def _take(self, report: NavReport) -> bool:
        """Send a solution if it is due."""
        self._heard = time.monotonic()
        age_s = (time.time_ns() - report.utc_ns) * 1e-9
        # Of the time for which "no solution" was said nothing else is said later.
        due = self._heard - age_s > self._blanked and self._pace.is_due(report.utc_ns)
        if due:
            self._send(report, report.utc_ns)
        return due

    def innovation(self, report: InnovationReport) -> None:
        """NMEA has no word for it."""

    def calibration(self, report: CalibrationReport) -> None:
        """NMEA has no word for it."""

    def target(self, report: TargetReport, own: NavReport) -> None:
        sentences = nmea_targets.write(report, own, self._settings.sentences, self._settings.talker)
        if sentences:
            self._sink.send(sentences)

    def health(self, report: msgspec.Struct) -> None:
        """NMEA has no word for it."""

    def status(self) -> SinkStatus:
        return self._sink.status()

    async def run(self) -> None:
        """Say "no solution" at the output's rate while there is none."""
        blanks = asyncio.create_task(self._blanks())
        try:
            await self._sink.ended.wait()
        finally:
            blanks.cancel()

    async def _blanks(self) -> None:
        while True:
            wait_s = self._next_blank() - time.monotonic()
            if wait_s > 0.0:
                await asyncio.sleep(wait_s)
            else:
                self._blanked = time.monotonic()
                self._send(None, time.time_ns())

    def _next_blank(self) -> float:
        """When to say that there is no solution, if none comes."""
        period_s = 1.0 / self._settings.rate_hz
        return max(self._heard + max(STALE_S, 2.0 * period_s), self._blanked + period_s)

    def _send(self, report: NavReport | None, utc_ns: int) -> None:
        s = self._settings
        sentences = nmea.epoch(
            report,
            utc_ns,
            s.sentences,
            s.talker,
            surface_height_m=s.surface_height_m,
            range_error_m=s.range_error_m,
        )
        self._sink.send(sentences)


class _TargetFeed(_NmeaFeed):
    """Sentences of a target, as if it were the vessel."""

    def nav(self, report: NavReport) -> bool:
        """It is not of us that this speaks."""
        return False

    def target(self, report: TargetReport, own: NavReport) -> None:
        vessel = nmea_targets.as_vessel(report, own)
        if report.name == self._settings.target and vessel is not None:
            self._take(vessel)


class _Publisher(Protocol):
    name: str

    def publish(self, topic: Any, report: msgspec.Struct | dict[str, Any]) -> None: ...

    def status(self) -> SinkStatus: ...


class _ZenohFeed:
    """JSON reports to Zenoh."""

    def __init__(self, settings: ZenohOutput, publisher: _Publisher) -> None:
        self._publisher = publisher
        self._pace = _Pace(settings.rate_hz)

    @property
    def name(self) -> str:
        return self._publisher.name

    def nav(self, report: NavReport) -> bool:
        due = self._pace.is_due(report.utc_ns)
        if due:
            self._publisher.publish("nav", report)
        return due

    def innovation(self, report: InnovationReport) -> None:
        self._publisher.publish("innovation", report)

    def calibration(self, report: CalibrationReport) -> None:
        self._publisher.publish("calibration", report)

    def target(self, report: TargetReport, own: NavReport) -> None:
        self._publisher.publish(f"target/{report.name}", report)

    def health(self, report: msgspec.Struct) -> None:
        self._publisher.publish("status", report)

    def status(self) -> SinkStatus:
        return self._publisher.status()

    async def run(self) -> None:
        """The publisher looks after itself."""
        await asyncio.Event().wait()
