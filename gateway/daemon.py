"""The daemon: devices into the filter process, its solutions into outputs, until told to stop."""

import asyncio
import logging
import signal
import time
from contextlib import AsyncExitStack

from drivers import hosttime
from drivers.links import Chunk, open_link
from drivers.links.pps import edges
from drivers.settings import StdioLink
from gateway import statefile, systemd
from gateway.clock import Clocks
from gateway.clock.utc import UtcHistory
from gateway.config import Config, NmeaOutput, Output, doubts
from gateway.filter_process.begun import Begun
from gateway.filter_process.host import FilterHost
from gateway.health import Health, Line
from gateway.ingest import intakes
from gateway.machine import bootclock, realtime
from gateway.machine.journal import open_journal
from gateway.machine.subordinate import ENDING
from gateway.messages import (
    Calibration,
    FilterCounts,
    FilterOutput,
    ImuBlock,
    Innovation,
    NavSolution,
    SavedState,
    TargetSighting,
)
from gateway.outputs.feeds import Feed, open_feed
from gateway.outputs.following import target_report
from gateway.outputs.schema import calibration_report, innovation_report, nav_report
from gateway.recording.host import Recorder
from gateway.resume import COLD, Resume
from gateway.supervise import Alive, keep_running
from gateway.targets import Targets

MIN_SOLUTION_RATE_HZ = 10.0
HEALTH_PERIOD_S = 1.0

_log = logging.getLogger(__name__)


def run(
    config: Config, *, nmea_stdout: bool = False, cold: bool = False, begun: Begun | None = None
) -> None:
    """Run until SIGTERM, SIGINT or SIGHUP, or until the reader of standard output is gone.

    Parameters
    ----------
    config
        A validated configuration.
    nmea_stdout
        Add an output of NMEA 0183 on standard output.
    cold
        Do not go on from the state file.
    begun
        The filter's template, started earlier to save time.
    """
    open_journal()
    for doubt in doubts(config):
        _log.warning("%s", doubt)
    outputs = list(config.outputs)
    if nmea_stdout:
        outputs.append(NmeaOutput(link=StdioLink()))
    asyncio.run(_Daemon(config, outputs, cold, begun).run())


class _Daemon:
    """The object graph of one run."""

    def __init__(
        self, config: Config, outputs: list[Output], cold: bool, begun: Begun | None
    ) -> None:
        self._config = config
        self._outputs = outputs
        self._stop = asyncio.Event()
        self._collector = realtime.Collector()
        self._feeds: list[Feed] = []
        rate_hz = max([MIN_SOLUTION_RATE_HZ, *(output.rate_hz for output in outputs)])
        path, self._claim = statefile.claimed(statefile.place(config.state))
        resume = COLD
        if path is not None and not cold:
            resume = statefile.resume(path, config, bootclock.now())
        self._keeper = None if path is None else statefile.Keeper(path, config)
        ways_in = intakes(config, resume.clocks)
        self._lines = [Line(intake) for intake in dict.fromkeys(ways_in.values())]
        self._host = FilterHost(config, rate_hz, self._on_output, resume.state, begun)
        self._utc = UtcHistory()
        self._targets = Targets(config.targets)
        self._recorder: Recorder | None = None
        if config.recording is not None:
            self._recorder = Recorder(config.recording, config, rate_hz, resume)
        self._health = Health(config.vehicle, self._lines, self._host, self._feeds, self._keeper)

    async def run(self) -> None:
        """Everything, until told to stop."""
        loop = asyncio.get_running_loop()
        for number in ENDING:
            if signal.getsignal(number) != signal.SIG_IGN:  # as nohup asks
                loop.add_signal_handler(number, self._stop.set)
        self._health.realtime, complaints = realtime.enter(self._config.realtime)
        for complaint in complaints:
            _log.warning("%s", complaint)
        async with AsyncExitStack() as stack:
            if self._keeper is not None:
                stack.callback(self._keeper.close)
            names = [target.name for target in self._config.targets.values()]
            # Zenoh first: handed over at once, it is on its way while sentences are written.
            for output in sorted(self._outputs, key=lambda o: isinstance(o, NmeaOutput)):
                feed = await stack.enter_async_context(
                    open_feed(output, self._config.vehicle, names)
                )
                self._feeds.append(feed)
            if self._recorder is not None:
                self._feeds.append(self._recorder)
            self._sample_utc()
            async with asyncio.TaskGroup() as group:
                tasks = [group.create_task(self._host.run(), name="filter")]
                tasks += [group.create_task(self._until_ended(feed)) for feed in self._feeds]
                sources = [group.create_task(self._ready()), group.create_task(self._watch())]
                sources += [group.create_task(self._read(line)) for line in self._lines]
                sources += [
                    group.create_task(self._feel(line, device))
                    for line in self._lines
                    for device in line.intake.ingests
                ]
                await self._stop.wait()
                systemd.notify_stopping()
                for task in sources:
                    task.cancel()
                await self._host.drain()
                for task in tasks:
                    task.cancel()
        _log.info("stopped")

    async def _read(self, line: Line) -> None:
        """Bring one line's bytes to the filter, for as long as the daemon runs."""
        settings = self._config.devices[line.name].link

        async def once(alive: Alive) -> None:
            def take(chunk: Chunk) -> None:
                alive()
                line.heard(time.monotonic())
                self._hand_on(line, chunk)

            async with open_link(settings, take, line.link) as link:
                line.opened(time.monotonic(), link.name)
                if self._recorder is not None:
                    self._recorder.line(line.name, up=True)
                try:
                    await link.lost()
                finally:
                    line.lost()
                    if self._recorder is not None:
                        self._recorder.line(line.name, up=False)

        await keep_running(line.name, once)

    async def _feel(self, line: Line, device: str) -> None:
        """Tell a device of the pulses that begin its seconds, where there are any."""
        pulses = self._config.devices[device].clock.pulses
        if pulses is None:
            return

        async def once(alive: Alive) -> None:
            async for t_ns in edges(pulses):
                alive()
                if self._recorder is not None:
                    self._recorder.pulse(device, t_ns)
                line.intake.pulse(t_ns, device)

        await keep_running(f"{device} pulses", once)

    def _hand_on(self, line: Line, chunk: Chunk) -> None:
        """Decode a chunk and give the filter what came of it."""
        passage, t_rx_ns = self._health.passage, chunk.t_rx_ns
        if self._recorder is not None:
            self._recorder.raw(line.name, chunk.data, t_rx_ns, chunk.source)
        line.intake.feed(chunk.data, t_rx_ns, chunk.source)
        decoded_ns = hosttime.now_ns()
        passage.decoded(line.name, t_rx_ns, decoded_ns)
        for measurement in line.intake.flush():
            self._host.send(measurement)
            sent_ns = hosttime.now_ns()
            passage.handed_on(line.name, decoded_ns, sent_ns)
            if isinstance(measurement, ImuBlock):
                passage.entered(measurement.t_last_ns, t_rx_ns, sent_ns)
        line.intake.learn()

    def _on_output(self, output: FilterOutput) -> None:
        """Hand on what the filter says, in the words of the edge."""
        now_ns = hosttime.now_ns()
        offset_ns = self._utc.at(output.t_ns)
        if isinstance(output, NavSolution):
            passage = self._health.passage
            passage.solved(output.t_ns, now_ns)
            nav = nav_report(output, offset_ns)
            for feed in self._feeds:
                if feed.nav(nav):
                    passage.published(feed.name, hosttime.now_ns())
            for followed in self._targets.due(output.t_ns):
                target = target_report(followed, nav)
                for feed in self._feeds:
                    feed.target(target, nav)
            self._health.solved(nav)
        elif isinstance(output, Innovation):
            self._health.plausibility.verdict(output)
            innovation = innovation_report(output, offset_ns)
            for feed in self._feeds:
                feed.innovation(innovation)
        elif isinstance(output, Calibration):
            calibration = calibration_report(output, offset_ns)
            for feed in self._feeds:
                feed.calibration(calibration)
        elif isinstance(output, TargetSighting):
            self._targets.take(output)
        elif isinstance(output, FilterCounts):
            self._health.totals = output
        elif isinstance(output, SavedState):
            self._keep(output)

    def _keep(self, state: SavedState) -> None:
        """Hand on what another daemon, or a replay, can go on from."""
        if self._keeper is None and self._recorder is None:
            return
        clocks: Clocks = {}
        for line in self._lines:
            clocks |= line.intake.clock_memory()
        if self._keeper is not None:
            self._keeper.keep(state, clocks)
        if self._recorder is not None:
            self._recorder.resume(Resume(state, clocks))

    def _sample_utc(self) -> None:
        """See how Unix time stands to the host's own; a recording keeps it for its replays."""
        now_ns = hosttime.now_ns()
        sample = self._utc.sample(now_ns, time.time_ns() - now_ns)
        self._health.host_clock.sampled(now_ns, sample.offset_ns, now_ns - time.monotonic_ns())
        if self._recorder is not None:
            self._recorder.utc(sample)

    async def _until_ended(self, feed: Feed) -> None:
        """Stop the daemon when an output has lost its reader for good."""
        await feed.run()
        self._stop.set()

    async def _ready(self) -> None:
        """Tell the service manager once the filter is compiled and waiting."""
        await self._host.ready.wait()
        self._collector.settle()
        systemd.notify_ready()
        _log.info("ready: %s", ", ".join(self._config.devices))

    async def _watch(self) -> None:
        """Publish the status, raise alarms, and feed the watchdog while solutions flow."""
        watchdog_s = systemd.watchdog_interval_s()
        fed_at = 0.0
        while True:
            await asyncio.sleep(min(HEALTH_PERIOD_S, watchdog_s or HEALTH_PERIOD_S))
            self._sample_utc()
            self._health.watch()
            await asyncio.sleep(0)  # in parts: a sample that comes meanwhile does not wait for all
            report = self._health.report()
            for feed in self._feeds:
                await asyncio.sleep(0)
                feed.health(report)
            systemd.notify_status(self._health.line())
            self._collector.quiet()
            now = time.monotonic()
            if watchdog_s is not None and now - fed_at >= watchdog_s and self._health.is_flowing():
                systemd.notify_watchdog()
                fed_at = now
