"""The filter process and its host: the same answers as in-process, through deaths of all kinds."""

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import pytest

from drivers.capture.streams import read_streams
from gateway.config import Config
from gateway.emulator import twin
from gateway.emulator.player import emulate
from gateway.estimator import Estimator
from gateway.filter_process import channel
from gateway.filter_process import host as host_module
from gateway.filter_process.host import FilterHost
from gateway.ingest import intakes
from gateway.messages import (
    Checkpoint,
    FilterCounts,
    FilterOutput,
    ImuBlock,
    Measurement,
    NavSolution,
    SavedState,
)
from gateway.schema import build
from tests.gateway.emulated import START, make
from tests.integration.rig import brisk
from tests.shared_data import ROOT

RATE_HZ = 10.0


@dataclass(frozen=True)
class Input:
    """A configuration, and measurements as they arrive live: one for each frame."""

    config: Config
    measurements: list[Measurement]
    outputs: list[FilterOutput]


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Input:
    folder = tmp_path_factory.mktemp("frames")
    scenario = twin.for_capture(make(brisk(folder) | {"duration_s": 12.0, "start": START}))
    emulate(scenario, pcap=folder / "frames.pcap", say=lambda _line: None)
    config = build(Config, twin.gateway_config(scenario), [])
    assert config is not None
    ways_in = intakes(config)
    links = {name: device.link for name, device in config.devices.items()}
    measurements: list[Measurement] = []
    for name, data, t_ns in read_streams([folder / "frames.pcap"], links):
        ways_in[name].feed(data, t_ns)
        measurements += ways_in[name].flush()
    estimator = Estimator(config, RATE_HZ)
    outputs = [output for m in measurements for output in estimator.feed(m)]
    return Input(config, measurements, outputs)


@dataclass
class Hosted:
    """A running host and what its workers have said."""

    host: FilterHost
    outputs: list[FilterOutput] = field(default_factory=list)
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def take(self, output: FilterOutput) -> None:
        self.outputs.append(output)
        self.news.set()

    def navs(self) -> list[NavSolution]:
        return [output for output in self.outputs if isinstance(output, NavSolution)]

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait for the host to say something that makes it true."""
        async with asyncio.timeout(20):
            while not condition():
                self.news.clear()
                with suppress(TimeoutError):
                    await asyncio.wait_for(self.news.wait(), 0.05)  # the status makes no news

    async def ready(self) -> int:
        """Process id of the worker, once it works."""
        await self.until(lambda: self.host.status.ready)
        assert self.host.status.pid is not None
        return self.host.status.pid

    async def solved(self, t_ns: int) -> None:
        await self.until(lambda: bool(self.navs()) and self.navs()[-1].t_ns >= t_ns)


@asynccontextmanager
async def hosted(config: Config) -> AsyncIterator[Hosted]:
    running = Hosted(FilterHost(config, RATE_HZ, lambda output: running.take(output)))
    task = asyncio.create_task(running.host.run())
    try:
        yield running
    finally:
        task.cancel()
        await asyncio.wait([task])
    assert task.cancelled()


def answers(outputs: list[FilterOutput]) -> list[FilterOutput]:
    """What reaches the daemon; a checkpoint stays with the host."""
    return [output for output in outputs if not isinstance(output, SavedState | Checkpoint)]


def last_nav(given: Input) -> NavSolution:
    return [output for output in given.outputs if isinstance(output, NavSolution)][-1]


async def test_a_process_says_what_the_estimator_says(given: Input) -> None:
    async with hosted(given.config) as running:
        for measurement in given.measurements:  # all at once: the channel fills up
            running.host.send(measurement)
        expected = answers(given.outputs)
        await running.until(lambda: len(running.outputs) >= len(expected))
        for got, want in zip(running.outputs, expected, strict=True):
            assert msgspec.msgpack.encode(got) == msgspec.msgpack.encode(want)
        assert (running.host.status.waiting, running.host.status.dropped) == (0, 0)


async def test_a_new_worker_goes_on_where_the_last_one_was(given: Input) -> None:
    half = len(given.measurements) // 2
    end = last_nav(given)
    async with hosted(given.config) as running:
        first = await running.ready()
        for measurement in given.measurements[:half]:
            running.host.send(measurement)
        await running.until(lambda: len(running.navs()) >= 50)
        used = running.navs()[-1].fixes_used
        assert used > 5
        os.kill(first, signal.SIGKILL)
        for measurement in given.measurements[half:]:
            running.host.send(measurement)
        await running.solved(end.t_ns)
        assert running.host.status.restarts == 1
        assert running.host.status.pid != first
    navs = running.navs()
    whole = [output for output in given.outputs if isinstance(output, NavSolution)]
    assert [nav.t_ns for nav in navs] == [nav.t_ns for nav in whole]  # none lost, none twice
    assert navs == whole


async def test_a_worker_that_dies_before_it_works_is_replaced(given: Input) -> None:
    async with hosted(given.config) as running:
        await running.until(lambda: running.host.status.pid is not None)
        pid = running.host.status.pid
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        for measurement in given.measurements[:500]:
            running.host.send(measurement)
        await running.until(lambda: len(running.navs()) > 10)
        assert running.host.status.restarts == 1


async def test_what_kills_every_worker_is_thrown_away(
    given: Input, caplog: pytest.LogCaptureFixture
) -> None:
    ragged = ImuBlock(b"\0" * 8, b"\0" * 56)  # seven numbers in a row of eight
    async with hosted(given.config) as running:
        await running.ready()
        for measurement in (*given.measurements[:900], ragged, *given.measurements[900:1000]):
            running.host.send(measurement)
        status = running.host.status
        await running.until(lambda: status.restarts == 3)
        assert 101 < status.dropped <= 1001
        for measurement in given.measurements[1000:]:
            running.host.send(measurement)
        await running.solved(last_nav(given).t_ns)
        assert status.restarts == 3
    complaints = [message for message in caplog.messages if "filter process" in message]
    assert complaints == ["filter process ended with exit code 1; starting it again"] * 3


async def test_a_worker_that_hangs_costs_the_oldest_data_only(
    given: Input, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_module, "MAX_WAITING", 500)
    monkeypatch.setattr(channel, "BUFFER_BYTES", 65_536)
    async with hosted(given.config) as running:
        pid = await running.ready()
        os.kill(pid, signal.SIGSTOP)
        for measurement in given.measurements:
            running.host.send(measurement)
        status = running.host.status
        assert status.waiting == 500
        assert 0 < status.dropped < len(given.measurements) - 500
        os.kill(pid, signal.SIGCONT)
        await running.solved(last_nav(given).t_ns)
        assert (status.restarts, running.navs()[-1].t_ns) == (0, last_nav(given).t_ns)


@pytest.mark.parametrize("hangs", [False, True])
async def test_a_worker_ends_with_its_host(given: Input, hangs: bool) -> None:
    async with hosted(given.config) as running:
        pid = await running.ready()
        if hangs:
            os.kill(pid, signal.SIGSTOP)
        else:  # signals are for the host to judge
            os.kill(pid, signal.SIGTERM)
            os.kill(pid, signal.SIGINT)
            running.host.send(given.measurements[0])
            await running.until(lambda: running.host.status.waiting == 0)
            assert running.host.status.restarts == 0
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


COMPILED = """
import sys
import msgspec
from gateway.estimator import Estimator
from gateway.filter_process.channel import Start, read_in_worker
from gateway.filter_process.worker import warm_up
from gateway.messages import Checkpoint, SavedState

def kernels():
    found = {}
    for module in [m for name, m in sys.modules.items() if name.startswith("gateway.")]:
        for name, value in vars(module).items():
            if hasattr(value, "nopython_signatures"):
                found[value.__module__ + "." + name] = list(value.nopython_signatures)
    return found

warm_up()
before = kernels()
start, *measurements = [read_in_worker(m) for m in msgspec.msgpack.decode(sys.stdin.buffer.read())]
half = len(measurements) // 2

def given_by(resume, measurements, kind):
    estimator = Estimator(start.config, start.rate_hz, resume)
    outputs = [output for measurement in measurements for output in estimator.feed(measurement)]
    return estimator, [output for output in outputs if isinstance(output, kind)]

_, states = given_by(None, measurements[:half], SavedState)
estimator, _ = given_by(states[-1], measurements[half:], SavedState)
_, checkpoints = given_by(None, measurements, Checkpoint)
for checkpoint in checkpoints[:1]:
    given_by(checkpoint, measurements[checkpoint.received :], Checkpoint)
after = kernels()
assert before
compiled = {name for name in after if after[name] != before[name]}
print(len(checkpoints), compiled or "nothing", estimator.counts())
"""


@pytest.mark.parametrize("unusual", [False, True])
def test_ready_means_that_nothing_is_left_to_compile(given: Input, unusual: bool) -> None:
    """Nor is anything for a worker that takes up where another left off."""
    plain = msgspec.to_builtins(given.config)
    plain["filter"]["history_s"] = 1.0
    if unusual:
        plain["filter"] |= {"coupling": "loose", "error": "left_invariant"}
        plain["initial"]["align"] = {"heading": "unknown", "level_s": 5.0}
        plain["devices"]["usbl0"]["prior"] |= {"latency_ms": 10.0, "lever_arm_m": 0.1}
    config = msgspec.convert(plain, Config)
    messages = [channel.Start(config, RATE_HZ, None), *given.measurements]
    done = subprocess.run(
        [sys.executable, "-c", COMPILED],
        input=msgspec.msgpack.encode([channel.encode(message) for message in messages]),
        capture_output=True,
        cwd=ROOT,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr.decode()
    checkpoints, compiled, counts = done.stdout.decode().split(" ", 2)
    assert compiled == "nothing"
    assert int(checkpoints) > 0 or unusual
    assert "fixes_used=0" not in counts
    assert FilterCounts.__name__ in counts


async def test_a_cold_start_is_told(
    given: Input,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """Half a minute in which nothing else is said: the cache of compiled functions is empty."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    caplog.set_level("INFO")
    async with hosted(given.config) as running:
        await running.until(lambda: "compiling the filter" in caplog.text)
        assert not running.host.status.ready
