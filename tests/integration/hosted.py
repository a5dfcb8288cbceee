"""A recorded voyage, and a filter process that is fed it."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from drivers.capture.streams import read_streams
from gateway.config import Config
from gateway.emulator import twin
from gateway.emulator.player import emulate
from gateway.estimator import Estimator
from gateway.filter_process.host import FilterHost
from gateway.ingest import intakes
from gateway.messages import Checkpoint, FilterOutput, Measurement, NavSolution
from gateway.schema import build
from tests.gateway.emulated import START, make
from tests.integration.rig import brisk

RATE_HZ = 10.0


@dataclass(frozen=True)
class Input:
    """A configuration, and measurements as they arrive live: one for each frame."""

    config: Config
    rate_hz: float
    measurements: list[Measurement]
    outputs: list[FilterOutput]


def recorded(
    folder: Path,
    *,
    duration_s: float = 12.0,
    imu_hz: float = 200.0,
    history_s: float = 1.0,
    rate_hz: float = RATE_HZ,
    level_s: float | None = None,
) -> Input:
    """A recording of the brisk scenario, and what an estimator makes of it.

    With `level_s` that has to find roll and pitch first.
    """
    data = brisk(folder) | {"duration_s": duration_s, "start": START}
    data["devices"]["imu0"]["rate_hz"] = imu_hz
    scenario = twin.for_capture(make(data))
    emulate(scenario, pcap=folder / "frames.pcap", say=lambda _line: None)
    settings = twin.gateway_config(scenario) | {"filter": {"history_s": history_s}}
    if level_s is not None:
        settings["initial"] |= {"align": {"heading": "config", "level_s": level_s}}
        settings["initial"]["attitude_deg"][:2] = [0.0, 0.0]
        settings["initial"]["sigma"]["attitude_deg"][:2] = [0.0, 0.0]
    config = build(Config, settings, [])
    assert config is not None
    ways_in = intakes(config)
    links = {name: device.link for name, device in config.devices.items()}
    measurements: list[Measurement] = []
    for name, chunk, t_ns, _ in read_streams([folder / "frames.pcap"], links):
        ways_in[name].feed(chunk, t_ns)
        measurements += ways_in[name].flush()
    estimator = Estimator(config, rate_hz)
    outputs = [output for m in measurements for output in estimator.feed(m)]
    return Input(config, rate_hz, measurements, outputs)


@dataclass
class Hosted:
    """A running host and what its workers have said."""

    host: FilterHost
    outputs: list[FilterOutput] = field(default_factory=list)
    heard: list[tuple[float, int]] = field(default_factory=list)
    """When each output came, and of which worker."""
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def take(self, output: FilterOutput) -> None:
        self.outputs.append(output)
        self.heard.append((time.perf_counter(), self.host.status.restarts))
        self.news.set()

    def navs(self) -> list[NavSolution]:
        return [output for output in self.outputs if isinstance(output, NavSolution)]

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait for the host to say something that makes it true."""
        async with asyncio.timeout(60):
            while not condition():
                self.news.clear()
                with suppress(TimeoutError):
                    await asyncio.wait_for(self.news.wait(), 0.05)  # the status makes no news

    async def ready(self) -> int:
        """Process id of the worker, once it works."""
        await asyncio.wait_for(self.host.ready.wait(), 120)  # it may have to compile first
        await self.until(lambda: self.host.status.pid is not None)
        assert self.host.status.pid is not None
        return self.host.status.pid

    async def solved(self, t_ns: int) -> None:
        await self.until(lambda: bool(self.navs()) and self.navs()[-1].t_ns >= t_ns)


@asynccontextmanager
async def hosted(given: Input) -> AsyncIterator[Hosted]:
    running = Hosted(FilterHost(given.config, given.rate_hz, lambda output: running.take(output)))
    task = asyncio.create_task(running.host.run())
    try:
        yield running
    finally:
        task.cancel()
        await asyncio.wait([task])
    assert task.cancelled()


def answers(outputs: list[FilterOutput]) -> list[FilterOutput]:
    """What reaches the daemon; a checkpoint stays with the host."""
    return [output for output in outputs if not isinstance(output, Checkpoint)]


def encoded(outputs: list[FilterOutput]) -> list[bytes]:
    """Outputs to be compared to the last bit, NaN with NaN as well."""
    return [msgspec.msgpack.encode(output) for output in outputs]


def last_nav(given: Input) -> NavSolution:
    return [output for output in given.outputs if isinstance(output, NavSolution)][-1]
